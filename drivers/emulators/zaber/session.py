"""The devices' side of Zaber's ASCII protocol: lines in, lines out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from drivers.emulators.wire import WireFaults


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a device says to a command."""

    data: str = "0"
    rejected: bool = False
    busy: bool = False
    flag: str = "--"


class Device(Protocol):
    """What carries commands out."""

    address: int
    faults: WireFaults

    @property
    def checks(self) -> bool:
        """Whether its replies bear check digits."""
        ...

    def run(self, axis: int, words: list[str]) -> Outcome:
        """Carry out a command for an axis, 0 for the whole device."""
        ...


class ZaberSession:
    """Takes bytes apart into commands and has the devices that are meant reply, in their order."""

    def __init__(self, devices: Sequence[Device]) -> None:
        self._devices = devices
        self._pending = b""

    def receive(self, data: bytes) -> Iterator[bytes]:
        """The replies to all lines that are complete; a line with wrong check digits gets none."""
        *lines, self._pending = (self._pending + data).replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            _, slash, text = line.decode("latin-1").partition("/")
            if slash and (checked := _without_check(text)) is not None:
                yield from self._replies(checked.split())

    def _replies(self, words: list[str]) -> Iterator[bytes]:
        numbers: list[str] = []
        while words and len(numbers) < 3 and words[0].isdigit():
            numbers.append(words.pop(0))
        address, axis = (int(numbers[place]) if len(numbers) > place else 0 for place in (0, 1))
        for device in self._devices:
            if address not in (0, device.address):
                continue
            outcome = device.run(axis, words)
            head = [f"{device.address:02d}", str(axis), *numbers[2:]]
            result = "RJ" if outcome.rejected else "OK"
            body = " ".join((*head, result, "BUSY" if outcome.busy else "IDLE", outcome.flag, outcome.data))
            reply = "@" + body + (f":{_lrc(body)}" if device.checks else "") + "\r\n"
            yield device.faults.outgoing(reply.encode("latin-1"))


def _lrc(text: str) -> str:
    total = 0
    for character in text:
        total = (total + ord(character)) & 0xFF
    return f"{(total ^ 0xFF) + 1 & 0xFF:02X}"


def _without_check(text: str) -> str | None:
    if len(text) < 3 or text[-3] != ":":
        return text
    return text[:-3] if text[-2:] == _lrc(text[:-3]) else None
