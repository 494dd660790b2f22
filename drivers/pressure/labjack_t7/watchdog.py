"""The T7's own watchdog: DAC0 falls to 0 V when nobody has asked the T7 anything for too long.

Registers: LabJack's Modbus map (github.com/labjack/ljm_constants, firmware 1.0016 and later). Order and wear: T-Series
Datasheet, section 23: it must be disabled while its settings are written, all of them are kept in flash, each write
wears it, and there are no volatile ones beside them. So they are read, and only what differs is written.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.errors import DeviceFaultError, ProtocolError, UnsupportedError
from drivers.pressure.labjack_t7.device import LabJackT7

ENABLE = 61600
ADVANCED, TIMEOUT_S = 61602, 61604
STRICT_ENABLE, RESET_ENABLE = 61610, 61620
DAC0_ENABLE, DAC0_VOLTS = 61640, 61642
REFUSED = "Modbus exception"
"""What tells a refusal from an answer that the wire garbled; both are a `ProtocolError`."""


class Watchdog:
    """Armed, it vents without a host; any answered request, each sample for one, keeps it away.

    What else the T7's owner has it do in time (digital lines, DAC1) is left as it is.

    Parameters
    ----------
    device : str
        Name of the device, for messages.
    labjack : LabJackT7
        Whose watchdog it is.
    timeout_s : int
        Silence after which it vents, s; 0: none of its registers is ever touched.
    """

    def __init__(self, device: str, labjack: LabJackT7, timeout_s: int) -> None:
        self.timeout_s = timeout_s
        self._device = device
        self._labjack = labjack
        self._wanted = {
            ADVANCED: 0,
            TIMEOUT_S: timeout_s,
            STRICT_ENABLE: 0,
            RESET_ENABLE: 0,
            DAC0_ENABLE: 1,
            DAC0_VOLTS: 0,  # 0 V as float32 has the bits of 0
        }
        self._lock = threading.Lock()
        self._armed = False
        self._seen_on_connection = 0

    @property
    def is_armed(self) -> bool:
        """Whether `arm` had to do with it, and `disarm` not since."""
        return self._armed

    def arm(self, doing: str) -> None:
        """See that it is set and armed; once a connection, whatever the T7 was told before.

        Raises `UnsupportedError` when the firmware does not have it, `DeviceFaultError` when it does not keep it, or
        as `drivers.modbus.Line` does.
        """
        if self.timeout_s == 0:
            return
        with self._lock, self._explained(doing):
            connection = self._labjack.connections
            if self._armed and self._seen_on_connection == connection:
                return
            enabled, different = self._labjack.read_uint(ENABLE, doing), self._different(doing)
            self._armed = True  # from the first write on it may be, also when its answer is lost
            if enabled and different:
                self._labjack.write_uint(ENABLE, 0, doing)
            for address in different:
                self._labjack.write_uint(address, self._wanted[address], doing)
            if different or enabled != 1:
                self._labjack.write_uint(ENABLE, 1, doing)
                self._verify(doing)
            self._seen_on_connection = connection

    def disarm(self, doing: str) -> None:
        """Disable it if `arm` has had to do with it; raises as `arm` does."""
        with self._lock, self._explained(doing):
            if self._armed:
                self._labjack.write_uint(ENABLE, 0, doing)
                self._armed = False

    def _different(self, doing: str) -> list[int]:
        return [address for address, value in self._wanted.items() if self._labjack.read_uint(address, doing) != value]

    def _verify(self, doing: str) -> None:
        if self._labjack.read_uint(ENABLE, doing) != 1 or self._different(doing):
            words = f"{doing}: its watchdog does not keep what it is set to"
            raise DeviceFaultError(self._device, words, "look what else writes to it")

    @contextmanager
    def _explained(self, doing: str) -> Iterator[None]:
        """Make one clear error of the firmware's refusal."""
        try:
            yield
        except (ProtocolError, DeviceFaultError) as error:
            if REFUSED not in error.doing:
                raise
            words = f"{doing}: its firmware {self._labjack.firmware} refuses the registers of its watchdog"
            hint = "update the firmware, or set watchdog_s = 0 to do without"
            raise UnsupportedError(self._device, words, hint) from error
