"""Faults of the wire between a driver and an emulator, on command."""

from __future__ import annotations

import threading
from enum import StrEnum


class WireFault(StrEnum):
    """What happens to an answer."""

    SILENCE = "silence"
    """It never comes."""
    LATE = "late"
    """It comes after `WireFaults.late_s`, perhaps when nobody waits for it any more."""
    GARBLED = "garbled"
    """One of its bytes is another."""
    PARTIAL = "partial"
    """Only its first half comes."""


class WireFaults:
    """The faults of one emulator's line; safe to use from any thread. ``late_s`` is how late a late answer is."""

    def __init__(self, late_s: float = 1.0) -> None:
        self.late_s = late_s
        self._left: dict[WireFault, int | None] = {}
        self._lock = threading.Lock()
        self._ended = threading.Event()

    def inject(self, fault: WireFault, *, count: int | None = None) -> None:
        """Begin a fault that strikes ``count`` answers, or all until `clear` when None."""
        if count is not None and count < 1:
            raise ValueError(f"a fault must strike at least once, not {count} times")
        if fault is WireFault.LATE:
            self._ended.clear()
        with self._lock:
            self._left[fault] = count

    def clear(self, fault: WireFault | None = None) -> None:
        """End one fault, or all of them; does nothing when there is none."""
        with self._lock:
            if fault is None:
                self._left.clear()
            else:
                self._left.pop(fault, None)
        if fault in (None, WireFault.LATE):
            self._ended.set()

    def outgoing(self, answer: bytes) -> bytes:
        """What of an answer goes over the wire; waits when it is late. Call it on the thread that answers."""
        if self._strikes(WireFault.SILENCE):
            return b""
        if self._strikes(WireFault.LATE):
            self._ended.wait(self.late_s)
        if self._strikes(WireFault.PARTIAL):
            answer = answer[: len(answer) // 2]
        if answer and self._strikes(WireFault.GARBLED):
            middle = len(answer) // 2
            answer = answer[:middle] + bytes([answer[middle] ^ 0x15]) + answer[middle + 1 :]
        return answer

    def _strikes(self, fault: WireFault) -> bool:
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
