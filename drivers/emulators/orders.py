"""Faults of an emulated rig on command: one line of text each, as a person or a script types it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.clock import Appointment, Clock
from drivers.emulators.wire import WireFault, WireFaults

EXAMPLE = "fault rotation silence 3"
LOST_PACKETS, POWER_CYCLE = "lost-packets", "power-cycle"
LOST_SHARE = 0.1
LONGEST_S = 86_400.0

_MEANINGS = {
    WireFault.SILENCE: "no answer comes",
    WireFault.LATE: "every answer comes a second late",
    WireFault.GARBLED: "one byte of every answer is another",
    WireFault.PARTIAL: "only the first half of every answer comes",
    LOST_PACKETS: f"of a camera's packets {100 * LOST_SHARE:g} % are lost",
    POWER_CYCLE: "off and on, at once and without SECONDS",
}


class OrderError(ValueError):
    """A line that is no order, in a sentence that says what would be one."""


@dataclass(frozen=True)
class EmulatedDevice:
    """What can be done to one device: to every line that it answers on."""

    faults: tuple[WireFaults, ...]
    power_cycle: Callable[[], None]
    lose_packets: Callable[[float], None] | None = None
    """Only a camera can; takes the share of the packets."""

    @property
    def can_have(self) -> tuple[str, ...]:
        """The names of its faults."""
        return (*WireFault, *([LOST_PACKETS] if self.lose_packets else []), POWER_CYCLE)


class FaultOrders:
    """Carries out ``fault DEVICE FAULT SECONDS``, ``fault DEVICE power-cycle`` and ``help``.

    Parameters
    ----------
    devices : mapping of str to EmulatedDevice
        By the names that an order may call them by.
    clock : Clock
        Ends the faults.
    """

    def __init__(self, devices: Mapping[str, EmulatedDevice], clock: Clock) -> None:
        self._devices = dict(devices)
        self._clock = clock
        self._lock = threading.Lock()
        self._ends: dict[tuple[str, str], tuple[object, Appointment]] = {}

    def carry_out(self, line: str) -> str:
        """Carry out a line and tell what was done; nothing for an empty one. Raises `OrderError`, `OSError`."""
        match line.split():
            case []:
                return ""
            case ["help"]:
                return self.help()
            case ["fault", name, "power-cycle"]:
                self._device(name, POWER_CYCLE).power_cycle()
                return f"{name}: switched off and on"
            case ["fault", name, fault, seconds] if fault != POWER_CYCLE:
                device, duration_s = self._device(name, fault), _duration_s(seconds)
                self._begin(name, fault, device, duration_s)
                return f"{name}: {fault} for {duration_s:g} s"
            case ["fault", _, "power-cycle", *_]:
                raise OrderError(f"{POWER_CYCLE} takes no seconds, it is over at once; leave them out")
            case ["fault", *_]:
                raise OrderError(f"a fault wants a device, its name and seconds, as in: {EXAMPLE}; help lists them")
            case [word, *_]:
                raise OrderError(f"{word!r} is no order; type help, or a fault as in: {EXAMPLE}")
        raise OrderError(f"type help, or a fault as in: {EXAMPLE}")

    def help(self) -> str:
        """What can be ordered."""
        lines = [f"fault DEVICE FAULT SECONDS, as in: {EXAMPLE}"]
        lines += [f"  {name}: {', '.join(device.can_have)}" for name, device in self._devices.items()]
        return "\n".join((*lines, *(f"{fault}: {meaning}" for fault, meaning in _MEANINGS.items())))

    def close(self) -> None:
        """End all faults at once."""
        with self._lock:
            for name, fault in list(self._ends):
                self._finish(name, fault)

    def _device(self, name: str, fault: str) -> EmulatedDevice:
        if name not in self._devices:
            raise OrderError(f"there is no device {name!r}; name one of {', '.join(self._devices)}")
        device = self._devices[name]
        if fault not in device.can_have:
            raise OrderError(f"{name} can not have {fault!r}; it can have {', '.join(device.can_have)}")
        return device

    def _begin(self, name: str, fault: str, device: EmulatedDevice, duration_s: float) -> None:
        """Begin a fault, or have one that is there end at another time."""
        order = object()
        with self._lock:
            if (name, fault) in self._ends:
                self._ends[name, fault][1].cancel()
            elif fault == LOST_PACKETS and device.lose_packets:
                device.lose_packets(LOST_SHARE)
            else:
                for faults in device.faults:
                    faults.inject(WireFault(fault))
            end = self._clock.call_at(self._clock.now_s() + duration_s, lambda: self._end(name, fault, order))
            self._ends[name, fault] = (order, end)

    def _end(self, name: str, fault: str, order: object) -> None:
        with self._lock:
            if self._ends.get((name, fault), (None,))[0] is order:  # else a later order holds
                self._finish(name, fault)

    def _finish(self, name: str, fault: str) -> None:
        """End a fault; the lock is held."""
        _, end = self._ends.pop((name, fault))
        end.cancel()
        device = self._devices[name]
        if fault == LOST_PACKETS and device.lose_packets:
            device.lose_packets(0.0)
        else:
            for faults in device.faults:
                faults.clear(WireFault(fault))


def _duration_s(text: str) -> float:
    try:
        duration_s = float(text)
    except ValueError:
        duration_s = 0.0
    if not 0.0 < duration_s <= LONGEST_S:
        raise OrderError(f"{text!r} is no duration; give seconds above 0, {LONGEST_S:g} at most")
    return duration_s
