"""What a Modbus device means when it refuses: exception codes of the application protocol, section 7."""

from __future__ import annotations

from pymodbus.pdu import ModbusPDU

from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    NotConnectedError,
    ProtocolError,
)

_MAP_HINT = "check the register map against the device's manual"
_REFUSALS: dict[int, tuple[type[DeviceError], str, str]] = {
    1: (ProtocolError, "it does not know this function", _MAP_HINT),
    2: (ProtocolError, "it has no such register", _MAP_HINT),
    3: (ProtocolError, "it refuses this value", _MAP_HINT),
    4: (DeviceFaultError, "it could not do it", "look at the device's own alarm"),
    6: (DeviceBusyError, "it is busy", "try again later, or end the other program that uses it"),
    10: (NotConnectedError, "the gateway has no path to it", "check the gateway's settings"),
    11: (DeviceTimeoutError, "the gateway got no answer from it", "check its power and its cable"),
}


def refusal(device: str, doing: str, answer: ModbusPDU) -> DeviceError:
    """The error that an exception answer stands for."""
    code = answer.exception_code
    kind, words, hint = _REFUSALS.get(code, (ProtocolError, "it refuses for an unknown reason", _MAP_HINT))
    return kind(device, f"{doing}: {words} (Modbus exception {code})", hint)
