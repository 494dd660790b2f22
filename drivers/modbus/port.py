"""Where a Modbus device is, and opening the port to it, with the reason when that fails."""

from __future__ import annotations

import errno
import os
import socket
import termios
from collections.abc import Callable
from typing import Annotated, Literal

import serial
from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from drivers.errors import DeviceBusyError, NotConnectedError

TCP = "tcp://"
PARITIES = {"none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD}
SILENCE_CHARACTERS = 4.0
LEAST_SILENCE_S = 0.003

Client = ModbusTcpClient | ModbusSerialClient
Trace = Callable[[bool, bytes], bytes]


def _known(address: str) -> str:
    if address.startswith(TCP):
        host, _, port = address.removeprefix(TCP).rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise ValueError(f"{address!r} must be tcp://HOST:PORT, for example tcp://192.168.1.20:502")
    elif not address.startswith("/"):
        raise ValueError(f"{address!r} must be tcp://HOST:PORT or a serial port's path, for example /dev/ttyUSB0")
    return address


Address = Annotated[str, AfterValidator(_known)]
"""``tcp://HOST:PORT`` for Modbus TCP, the path of a serial port for Modbus RTU."""


class SerialSettings(BaseModel):
    """How a serial port talks; without meaning for TCP."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    baudrate: int = Field(default=115200, ge=1200, le=3_000_000, description="bits per second")
    parity: Literal["none", "even", "odd"] = Field(default="even", description="parity bit; pseudo terminals know none")
    stopbits: Literal[1, 2] = Field(default=1, description="stop bits")

    @property
    def silence_s(self) -> float:
        """Silence that ends a frame: 3.5 characters by the standard, and what drives ask for beyond it."""
        bits = 9 + (self.parity != "none") + self.stopbits
        return max(LEAST_SILENCE_S, SILENCE_CHARACTERS * bits / self.baudrate)


def is_tcp(address: str) -> bool:
    """Whether this is the address of a Modbus TCP device."""
    return address.startswith(TCP)


def open_client(device: str, address: str, settings: SerialSettings, timeout_s: float, trace: Trace) -> Client:
    """A client whose port is open; ``trace(sending, data)`` sees its bytes.

    Raises `NotConnectedError`, or `DeviceBusyError` when another program has the serial port.
    """
    doing = f"opening {address}"
    if is_tcp(address):
        host, _, port = address.removeprefix(TCP).rpartition(":")
        client = ModbusTcpClient(host, port=int(port), timeout=timeout_s, retries=0, trace_packet=trace)
        try:
            client.socket = socket.create_connection((host, int(port)), timeout=timeout_s)
        except OSError as error:
            hint = "check its power, its cable and the address"
            raise NotConnectedError(device, f"{doing}: {error}", hint) from error
        client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return client
    parity = PARITIES[settings.parity]
    client = ModbusSerialClient(
        address,
        baudrate=settings.baudrate,
        parity=parity,
        stopbits=settings.stopbits,
        timeout=timeout_s,
        retries=0,
        trace_packet=trace,
    )
    try:
        client.socket = serial.Serial(
            address,
            baudrate=settings.baudrate,
            parity=parity,
            stopbits=settings.stopbits,
            timeout=timeout_s,
            write_timeout=timeout_s,
            exclusive=True,
        )
    except (OSError, termios.error) as error:
        raise _not_opened(device, doing, error) from error
    return client


def _not_opened(device: str, doing: str, error: Exception) -> NotConnectedError | DeviceBusyError:
    code = error.errno if isinstance(error, OSError) else None
    if code in (errno.EBUSY, errno.EAGAIN):
        return DeviceBusyError(device, f"{doing}: another program has this port", "end that program")
    if code == errno.EACCES:
        return NotConnectedError(device, f"{doing}: not allowed", "add this user to the group dialout")
    reason = os.strerror(code) if code is not None else str(error)
    return NotConnectedError(device, f"{doing}: {reason}", "check its power, its cable and the serial settings")
