"""A Modbus device's answer to a request: Modbus Application Protocol 1.1b3, sections 6 and 7."""

from __future__ import annotations

import struct
from typing import Protocol

READ_HOLDING, READ_INPUT, WRITE_ONE, DIAGNOSTICS, WRITE_MANY = 3, 4, 6, 8, 16
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3


class RefusedError(Exception):
    """The device answers with an exception code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"Modbus exception {code}")


class Registers(Protocol):
    """The registers of one device."""

    def read(self, address: int, count: int) -> list[int]:
        """The 16-bit words at ``address``. Raises `RefusedError`."""
        ...

    def write(self, address: int, words: list[int]) -> None:
        """Take words at ``address``. Raises `RefusedError`."""
        ...


def answer_to(request: bytes, registers: Registers) -> bytes:
    """The answer, from its function code on."""
    try:
        return _answer(request, registers)
    except RefusedError as refused:
        return bytes([request[0] | 0x80, refused.code])
    except (struct.error, IndexError):
        return bytes([request[0] | 0x80, ILLEGAL_VALUE])


def _answer(request: bytes, registers: Registers) -> bytes:
    function = request[0]
    if function in (READ_HOLDING, READ_INPUT):
        address, count = struct.unpack(">HH", request[1:5])
        if not 1 <= count <= 125:
            raise RefusedError(ILLEGAL_VALUE)
        words = registers.read(address, count)
        return struct.pack(f">BB{count}H", function, 2 * count, *words)
    if function == WRITE_ONE:
        address, word = struct.unpack(">HH", request[1:5])
        registers.write(address, [word])
        return request
    if function == WRITE_MANY:
        address, count, size = struct.unpack(">HHB", request[1:6])
        if not 1 <= count <= 123 or size != 2 * count or len(request) != 6 + size:
            raise RefusedError(ILLEGAL_VALUE)
        registers.write(address, list(struct.unpack(f">{count}H", request[6:])))
        return request[:5]
    if function == DIAGNOSTICS and request[1:3] == b"\x00\x00":
        return request
    raise RefusedError(ILLEGAL_FUNCTION)
