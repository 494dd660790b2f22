"""The bytes between the host and a controller: a serial port that is ours alone, or a TCP connection.

What goes wrong below an axis is told by the errors of this module; `drivers.stages.axis` makes ours of them.
"""

from __future__ import annotations

import errno
import select
import socket
from collections.abc import Callable
from typing import Protocol

import serial

CHUNK = 4096
WRITE_TIMEOUT_S = 1.0


class LineError(Exception):
    """Anything that goes wrong on a line; raise a subclass."""


class LineLostError(LineError):
    """The line can not be opened, or is gone."""


class LineTakenError(LineError):
    """Another program has the line."""


class NoAnswerError(LineError):
    """Nothing came in time, or only a part."""


class BadAnswerError(LineError):
    """What came makes no sense."""


class RefusedError(LineError):
    """The device understood and does not do it."""


class Line(Protocol):
    """An open line; used by one thread at a time."""

    def write(self, data: bytes) -> None:
        """Send all of it. Raises `LineLostError`."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """What has come, at once when something has; empty when nothing came in time. Raises `LineLostError`."""
        ...

    def close(self) -> None:
        """Give the line free; may be called twice."""
        ...


class SerialLine:
    """A serial port, locked (``flock``) against all programs that ask, as the makers' own do.

    Raises `LineTakenError` and `LineLostError`.
    """

    def __init__(self, path: str, *, baud: int, stop_bits: int) -> None:
        try:
            self._port = serial.Serial(
                path,
                baudrate=baud,
                bytesize=serial.EIGHTBITS,
                parity=serial.PARITY_NONE,
                stopbits=stop_bits,
                timeout=0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True,
            )
        except serial.SerialException as err:
            raise _why_not_open(path, err) from err

    def write(self, data: bytes) -> None:
        """Send all of it."""
        try:
            self._port.write(data)
        except (OSError, serial.SerialException) as err:
            raise LineLostError(f"the port is gone ({err})") from err

    def read(self, timeout_s: float) -> bytes:
        """What has come."""
        try:
            if not select.select([self._port.fileno()], [], [], max(0.0, timeout_s))[0]:
                return b""
            return self._port.read(CHUNK)
        except (OSError, serial.SerialException) as err:
            raise LineLostError(f"the port is gone ({err})") from err

    def close(self) -> None:
        """Give the port free."""
        self._port.close()


class TcpLine:
    """A TCP connection, to a serial device server or to a controller with a network port.

    Raises `LineLostError`; `LineTakenError` when it is hung up on before a byte has come.
    """

    def __init__(self, host: str, port: int, *, timeout_s: float) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout_s)
        except OSError as err:
            raise LineLostError(f"no connection to {host}:{port} ({err})") from err
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._heard = False

    def write(self, data: bytes) -> None:
        """Send all of it."""
        try:
            self._socket.settimeout(WRITE_TIMEOUT_S)
            self._socket.sendall(data)
        except OSError as err:
            raise self._lost(str(err)) from err

    def read(self, timeout_s: float) -> bytes:
        """What has come."""
        try:
            if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
                return b""
            data = self._socket.recv(CHUNK)
        except OSError as err:
            raise self._lost(str(err)) from err
        if not data:
            raise self._lost("hung up")
        self._heard = True
        return data

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def _lost(self, reason: str) -> LineError:
        if self._heard:
            return LineLostError(f"the connection is gone ({reason})")
        return LineTakenError(f"it hangs up before it says a word ({reason}); probably another program is connected")


def open_line(address: str, *, baud: int, stop_bits: int, timeout_s: float) -> Line:
    """Open ``tcp://host:port`` or a serial port's path, best one under ``/dev/serial/by-id``."""
    if address.startswith("tcp://"):
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        return TcpLine(host.strip("[]"), int(port), timeout_s=timeout_s)
    return SerialLine(address, baud=baud, stop_bits=stop_bits)


OpenLine = Callable[[], Line]


def _why_not_open(path: str, err: serial.SerialException) -> LineError:
    # pyserial keeps the number of a failed open, and puts that of a failed lock into its text only
    if err.errno in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(err):
        return LineTakenError(f"{path} is taken by another program")
    if err.errno == errno.ENOENT:
        return LineLostError(f"there is no port {path}")
    if err.errno == errno.EACCES:
        return LineLostError(f"no permission to open {path}; add the user to the group dialout")
    return LineLostError(f"{path} can not be opened ({err})")
