"""The controller's side of the XIMC protocol: which messages there are, and how bytes become messages.

Source: Standa's description of the XIMC protocol, version 20.8.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Protocol

SETTINGS = {
    "mov": struct.Struct("<IBHHIBB9x"),
    "eng": struct.Struct("<HHIBHhBHH10x"),
    "ent": struct.Struct("<BB6x"),
    "eds": struct.Struct("<BBihih6x"),
    "hom": struct.Struct("<IBIBihH9x"),
    "fbs": struct.Struct("<HBBI4x"),
    "pwr": struct.Struct("<BHHHB6x"),
    "nmf": struct.Struct("<16sB7x"),
    "nme": struct.Struct("<16s8x"),
}
"""Read by ``g`` and written by ``s`` and the name."""
ANSWERS = {
    "gets": struct.Struct("<BBBBBihqihhhhhhIIB4x"),
    "gpos": struct.Struct("<ihq6x"),
    "geti": struct.Struct("<4s2s8sBBH12x"),
    "gser": struct.Struct("<I"),
    "gfwv": struct.Struct("<BBH"),
    "gblv": struct.Struct("<BBH"),
}
ORDERS = {
    "spos": struct.Struct("<ihqB5x"),
    "move": struct.Struct("<ih6x"),
    "movr": struct.Struct("<ih6x"),
}
PLAIN = frozenset({"home", "zero", "stop", "sstp", "left", "rigt", "loft", "pwof", "save", "read"})

for _name, _layout in SETTINGS.items():
    ANSWERS[f"g{_name}"] = _layout
    ORDERS[f"s{_name}"] = _layout


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
        table.append(value)
    return tuple(table)


_CRC = _crc_table()


def checksum(payload: bytes) -> bytes:
    """CRC-16/Modbus, low byte first."""
    value = 0xFFFF
    for byte in payload:
        value = value >> 8 ^ _CRC[(value ^ byte) & 0xFF]
    return value.to_bytes(2, "little")


class ClippedError(Exception):
    """A value was out of range, and the nearest one allowed was taken."""


class Device(Protocol):
    """What carries the messages out."""

    def read(self, code: str) -> tuple[int | bytes, ...]:
        """The fields of an answer of `ANSWERS`."""
        ...

    def write(self, code: str, fields: tuple[int | bytes, ...]) -> None:
        """Carry out an order of `ORDERS`. Raises `ClippedError`."""
        ...

    def do(self, code: str) -> None:
        """Carry out an order of `PLAIN`."""
        ...

    def complain(self, code: str) -> None:
        """Take note that ``errc``, ``errd`` or ``errv`` was answered."""
        ...


class XimcSession:
    """Takes bytes apart into messages, and has a device answer them."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._pending = b""

    def receive(self, data: bytes) -> Iterator[bytes]:
        """The answers to all messages that are complete; a 0 in front of a message is answered by a 0."""
        self._pending += data
        while self._pending:
            if self._pending[0] == 0:
                self._pending = self._pending[1:]
                yield b"\0"
                continue
            code = self._pending[:4].decode("latin-1")
            length = 4 + (ORDERS[code].size + 2 if code in ORDERS else 0)
            if len(self._pending) < length:
                return
            payload, self._pending = self._pending[4:length], self._pending[length:]
            yield self._answer(code, payload)

    def _answer(self, code: str, payload: bytes) -> bytes:
        echo = code.encode("latin-1")
        if code in ANSWERS:
            body = ANSWERS[code].pack(*self._device.read(code))
            return echo + body + checksum(body)
        if code in PLAIN:
            self._device.do(code)
            return echo
        if code not in ORDERS:
            return self._complaint("errc")
        if checksum(payload[:-2]) != payload[-2:]:
            return self._complaint("errd")
        try:
            self._device.write(code, ORDERS[code].unpack(payload[:-2]))
        except ClippedError:
            return self._complaint("errv")
        return echo

    def _complaint(self, code: str) -> bytes:
        self._device.complain(code)
        return code.encode()
