"""Modbus devices on one RS-485 line behind a pseudo terminal: Modbus over Serial Line 1.02."""

from __future__ import annotations

import os
import select
import tempfile
import threading
import tty
from collections.abc import Mapping
from pathlib import Path

from drivers.emulators.modbus.pdu import READ_HOLDING, READ_INPUT, WRITE_MANY, WRITE_ONE, Registers, answer_to
from drivers.emulators.wire import WireFaults

SILENCE_S = 0.05
"""What is not whole by then never will be; generous, for a loaded host is slower than a serial line."""
JOINED_WITHIN_S = 5.0


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


class RtuServer:
    """Serves behind a path that stays the same when it is unplugged and plugged in again.

    Parameters
    ----------
    units : mapping of int to Registers
        The devices on the line; requests to others, and broken ones, get no answer.
    faults : WireFaults
        Faults of its answers.
    """

    def __init__(self, units: Mapping[int, Registers], faults: WireFaults) -> None:
        self._units = units
        self._faults = faults
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._path = ""
        self._ends: tuple[int, int] | None = None
        self._wake: tuple[int, int] | None = None
        self._thread: threading.Thread | None = None

    @property
    def address(self) -> str:
        """Path of the serial port; known once started."""
        return self._path

    def start(self) -> None:
        """Make the port; does nothing when it is there."""
        if self._thread is not None:
            return
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="bscd-rs485-")
            self._path = str(Path(self._folder.name) / "port")
        self._ends = os.openpty()
        tty.setraw(self._ends[1])
        Path(self._path).symlink_to(os.ttyname(self._ends[1]))
        self._wake = os.pipe()
        self._thread = threading.Thread(
            target=self._serve, args=(self._ends[0], self._wake[0]), name="modbus rtu emulator"
        )
        self._thread.start()

    def unplug(self) -> None:
        """Let the port vanish, as a serial adapter that is pulled out; `start` plugs it in again."""
        if self._thread is None or self._ends is None or self._wake is None:
            return
        os.write(self._wake[1], b".")
        self._thread.join(JOINED_WITHIN_S)
        for end in (*self._ends, *self._wake):
            os.close(end)
        Path(self._path).unlink()
        self._thread = self._ends = self._wake = None

    def drop(self) -> None:
        """Nothing: a serial port does not notice that its devices are switched off."""

    def stop(self) -> None:
        """Remove the port and join the thread; does nothing when stopped."""
        self.unplug()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def _serve(self, line: int, wake: int) -> None:
        received = b""
        while True:
            ready, _, _ = select.select([line, wake], [], [], SILENCE_S)
            if wake in ready:
                return
            if not ready:
                received = b""
                continue
            received += os.read(line, 4096)
            size = request_size(received)
            if size is not None and len(received) >= size:
                if answer := self._answer(received[:size]):
                    os.write(line, answer)
                received = received[size:]

    def _answer(self, request: bytes) -> bytes:
        unit = request[0]
        if unit not in self._units or checksum(request[:-2]) != request[-2:]:
            return b""
        answer = bytes([unit]) + answer_to(request[1:-2], self._units[unit])
        return self._faults.outgoing(answer + checksum(answer))
