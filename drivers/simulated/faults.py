"""Faults put into a simulated device on command, and ended on command."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from enum import StrEnum

from drivers.errors import UnsupportedError


class Fault(StrEnum):
    """What can go wrong, and the error it ends in."""

    NO_ANSWER = "no_answer"
    """Commands get no answer: `DeviceTimeoutError` after the answer time-out, `NotConnectedError` on connecting."""
    STALLED_MOVE = "stalled_move"
    """The motor stands still and the controller notices: `DeviceFaultError`."""
    HANGING_MOVE = "hanging_move"
    """The motor stands still but is reported as moving: `DeviceTimeoutError` after the move's time-out."""
    LIMIT_HIT = "limit_hit"
    """The move runs into a limit switch: `DeviceFaultError`."""
    DROPPED_FRAME = "dropped_frame"
    """An exposure never arrives: a jump of the frame id, `DeviceTimeoutError` when no other frame comes."""


class Faults:
    """The faults of one device; safe to use from any thread.

    Parameters
    ----------
    device : str
        Name of the device, for messages.
    known : iterable of Fault
        The faults that this kind of device can have.
    """

    def __init__(self, device: str, known: Iterable[Fault]) -> None:
        self._device = device
        self._known = frozenset(known)
        self._left: dict[Fault, int | None] = {}
        self._lock = threading.Lock()

    def inject(self, fault: Fault, *, count: int | None = None) -> None:
        """Begin a fault that strikes ``count`` times, or until `clear` when None.

        Raises `UnsupportedError` for a fault that this kind of device can not have.
        """
        if fault not in self._known:
            known = ", ".join(sorted(self._known))
            raise UnsupportedError(self._device, f"can not have the fault {fault.value!r}", f"it can have {known}")
        if count is not None and count < 1:
            raise ValueError(f"{self._device}: a fault must strike at least once, not {count} times")
        with self._lock:
            self._left[fault] = count

    def clear(self, fault: Fault | None = None) -> None:
        """End one fault, or all of them; does nothing when there is none."""
        with self._lock:
            if fault is None:
                self._left.clear()
            else:
                self._left.pop(fault, None)

    def active(self) -> frozenset[Fault]:
        """The faults that have begun and not ended."""
        with self._lock:
            return frozenset(self._left)

    def strike(self, fault: Fault) -> bool:
        """Whether ``fault`` strikes now; uses up one of its strikes."""
        with self._lock:
            if fault not in self._left:
                return False
            left = self._left[fault]
            if left is not None:
                if left == 1:
                    del self._left[fault]
                else:
                    self._left[fault] = left - 1
            return True
