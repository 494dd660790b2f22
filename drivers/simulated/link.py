"""The connection between the host and one simulated device: open or closed, answering or silent."""

from __future__ import annotations

import math
import threading

from drivers.clock import Clock
from drivers.errors import DeviceTimeoutError, NotConnectedError
from drivers.simulated.faults import Fault, Faults


class Link:
    """Opens, closes and carries commands; safe to use from any thread.

    Parameters
    ----------
    device : str
        Name of the device, for messages.
    clock : Clock
        Waits for answers that do not come.
    faults : Faults
        Where `Fault.NO_ANSWER` makes the device silent.
    answer_timeout_s : float
        How long a command waits for its answer.
    """

    def __init__(self, device: str, clock: Clock, faults: Faults, answer_timeout_s: float) -> None:
        self._device = device
        self._clock = clock
        self._faults = faults
        self._answer_timeout_s = answer_timeout_s
        self._opening = threading.Lock()
        self._open = False

    @property
    def is_open(self) -> bool:
        """Whether the connection is open."""
        return self._open

    def open(self) -> None:
        """Connect; does nothing when open. Raises `NotConnectedError` when the device is silent."""
        with self._opening:
            if self._open:
                return
            if self._silent(self._answer_timeout_s):
                raise NotConnectedError(
                    self._device,
                    f"no answer within {self._answer_timeout_s:g} s while connecting",
                    "check its power and its cable",
                )
            self._open = True

    def close(self) -> None:
        """Disconnect; does nothing when closed, never raises."""
        self._open = False

    def require_open(self, doing: str) -> None:
        """Raise `NotConnectedError` when closed; sends nothing."""
        if not self._open:
            raise NotConnectedError(self._device, f"{doing}: it is not connected", "call connect() first")

    def ask(self, doing: str, *, within_s: float = math.inf) -> None:
        """Send a command and await its answer, for ``within_s`` at most.

        Raises `NotConnectedError` when closed and `DeviceTimeoutError` when the device is silent.
        """
        self.require_open(doing)
        timeout_s = min(within_s, self._answer_timeout_s)
        if self._silent(timeout_s):
            hint = "check its power and its cable"
            raise DeviceTimeoutError(self._device, f"{doing}: no answer within {timeout_s:g} s", hint)

    def _silent(self, timeout_s: float) -> bool:
        if not self._faults.strike(Fault.NO_ANSWER):
            return False
        self._clock.sleep(timeout_s)
        return True
