"""Modbus frames on TCP and on a serial line, as a device reads and writes them.

Modbus Messaging on TCP/IP 1.0b, section 3; Modbus over Serial Line 1.02, section 2.5.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping

from drivers.clock import Clock
from drivers.emulators.modbus.pdu import READ_HOLDING, READ_INPUT, WRITE_MANY, WRITE_ONE, Registers, answer_to

HEADER = struct.Struct(">HHHB")
"""Transaction, protocol, length of what follows it, unit."""
LONGEST = 254
SILENCE_S = 0.05
"""A serial frame that is not whole by then never will be; generous, for a host is slower than a serial line."""


class TcpSession:
    """One connection to devices behind a TCP port; other units do not answer."""

    def __init__(self, units: Mapping[int, Registers]) -> None:
        self._units = units
        self._received = b""

    def receive(self, data: bytes) -> Iterator[bytes]:
        """See `drivers.emulators.lines.Session`."""
        self._received += data
        while len(self._received) >= HEADER.size:
            transaction, protocol, length, unit = HEADER.unpack_from(self._received)
            if protocol != 0 or not 2 <= length <= LONGEST:
                self._received = b""
                return
            end = HEADER.size + length - 1
            if len(self._received) < end:
                return
            request, self._received = self._received[HEADER.size : end], self._received[end:]
            if unit in self._units:
                answer = answer_to(request, self._units[unit])
                yield HEADER.pack(transaction, 0, len(answer) + 1, unit) + answer


class RtuSession:
    """Devices on one RS-485 line; requests to others, and broken ones, get no answer."""

    def __init__(self, units: Mapping[int, Registers], clock: Clock) -> None:
        self._units = units
        self._clock = clock
        self._received = b""
        self._received_s = clock.now_s()

    def receive(self, data: bytes) -> Iterator[bytes]:
        """See `drivers.emulators.lines.Session`."""
        now_s = self._clock.now_s()
        if now_s - self._received_s > SILENCE_S:
            self._received = b""
        self._received, self._received_s = self._received + data, now_s
        size = request_size(self._received)
        if size is None or len(self._received) < size:
            return
        frame, self._received = self._received[:size], b""
        unit, request = frame[0], frame[1:-2]
        if unit in self._units and checksum(frame[:-2]) == frame[-2:]:
            answer = bytes([unit]) + answer_to(request, self._units[unit])
            yield answer + checksum(answer)


def checksum(frame: bytes) -> bytes:
    """CRC-16 of the standard's appendix B, bit by bit, low byte first."""
    crc = 0xFFFF
    for byte in frame:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return bytes([crc & 0xFF, crc >> 8])


def request_size(start: bytes) -> int | None:
    """Bytes of the request that begins so, checksum included; None when it can not be told yet."""
    if len(start) < 2:
        return None
    if start[1] == WRITE_MANY:
        return 9 + start[6] if len(start) > 6 else None
    return 8 if start[1] in (READ_HOLDING, READ_INPUT, WRITE_ONE) else max(8, len(start))
