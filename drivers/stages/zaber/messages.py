"""The messages of Zaber's ASCII protocol, as lines of text, and its units.

``/1 1 14 move abs 50000:B7`` is for device 1, axis 1, and bears the number 14; ``@01 1 14 OK BUSY WR 0:0E`` is its
reply. The two digits after the colon are the negative sum of what is between the first character and the colon.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

SPEED_UNIT = 1.6384
"""Units of ``maxspeed`` per microstep/s."""
ACCELERATION_UNIT = 1.6384e-4
"""Units of ``accel`` per microstep/s^2."""
MESSAGE_IDS = 100
NO_FLAG = "--"

_REPLY = re.compile(r"(\d{2}) (\d) (\d{2}) (OK|RJ) (IDLE|BUSY) (--|[A-Z]{2}) (.+)")

UNREFERENCED = frozenset({"WR", "WH"})
"""Warnings that say that it does not know where it is."""
INTERRUPTED = "NI"
"""Warning that the last motion was ended by another order."""
FAULTS = {
    "FF": "a critical error of its system",
    "FN": "its peripheral is not supported",
    "FZ": "its peripheral is not active",
    "FH": "its emergency stop is pressed",
    "FV": "its supply voltage is too high or too low",
    "FO": "its driver is switched off",
    "FC": "its current is too high",
    "FM": "its motor is too hot",
    "FD": "its driver is switched off",
    "FQ": "its encoder has failed",
    "FI": "its index mark is not where it should be",
    "FA": "its encoder is out of step",
    "FR": "it was driven too hard",
    "FS": "motor stalled",
    "FB": "a sequence left its bounds",
    "FP": "it left its path",
    "FE": "limit switch hit",
    "FT": "it is twisted too far",
    "WL": "limit switch hit",
    "WT": "the controller is too hot",
    "WM": "it was pushed away at rest",
}
"""Warnings that are a fault, in words; others that begin with F are faults as well."""
REJECTIONS = {
    "AGAIN": "it can not just now",
    "BADAXIS": "it has no such axis",
    "BADCOMMAND": "it does not know the command or the setting",
    "BADDATA": "the value is not allowed",
    "DRIVERDISABLED": "its driver is switched off",
    "FULL": "it has no room for more orders",
    "LOCKSTEP": "the axis is locked to another",
    "NOACCESS": "the setting is protected",
    "PARKED": "it is parked",
    "STATUSBUSY": "it is busy",
}


@dataclass(frozen=True, slots=True)
class Reply:
    """What a device says to one message."""

    address: int
    axis: int
    message_id: int
    accepted: bool
    busy: bool
    flag: str
    """The gravest warning, ``--`` for none."""
    data: str


def native_speed(microsteps_per_s: float) -> int:
    """A speed in the device's unit."""
    return round(microsteps_per_s * SPEED_UNIT)


def native_acceleration(microsteps_per_s2: float) -> int:
    """An acceleration in the device's unit."""
    return round(microsteps_per_s2 * ACCELERATION_UNIT)


def check_digits(text: str) -> str:
    """The two digits of a text."""
    return f"{-sum(text.encode('latin-1')) % 256:02X}"


def encode(address: int, axis: int, message_id: int, command: str) -> bytes:
    """The bytes of a message."""
    text = f"{address} {axis} {message_id:02d} {command}"
    return f"/{text}:{check_digits(text)}\n".encode()


def decode(line: bytes, *, unchecked: bool = False) -> Reply | None:
    """A line as a reply; None when it is something else, garbled, or without check digits that were not given up."""
    # before the last @ there may be what is left of a reply that was cut off
    _, start, text = line.decode("latin-1").rstrip("\r").rpartition("@")
    body, colon, digits = text.rpartition(":")
    if not colon and unchecked:
        body = text
    elif not colon or digits != check_digits(body):
        return None
    match = _REPLY.fullmatch(body)
    if not match or not start:
        return None
    address, axis, message_id, accepted, busy, flag, data = match.groups()
    return Reply(int(address), int(axis), int(message_id), accepted == "OK", busy == "BUSY", flag, data)
