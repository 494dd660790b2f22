"""The XIMC messages that the driver uses, as bytes; Standa's description of the XIMC protocol, version 20.8.

A message to the controller is four letters and, where it brings values, these and their checksum. The answer
repeats the letters and, where it brings values, these and their checksum. All numbers are little-endian.
"""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag
from typing import NamedTuple

READS = {
    "gets": "<BBBBBihqihhhhhhIIB4x",
    "gmov": "<IBHHIBB9x",
    "geng": "<HHIBHhBHH10x",
    "geti": "<4s2s8sBBH12x",
    "gser": "<I",
    "gfwv": "<BBH",
    "gblv": "<BBH",
}
"""Code -> layout of the answer's values."""
WRITES = {
    "smov": ("<IBHHIBB", 9),
    "seng": ("<HHIBHhBHH", 10),
    "shom": ("<IBIBihH", 9),
    "spos": ("<ihqB", 5),
    "move": ("<ih", 6),
}
"""Code -> layout of the message's values, and how many reserved bytes follow."""
RESERVED = b"\xcc"
"""Any byte would do; this one makes our messages those of the maker's own library."""
PLAIN = ("home", "zero", "stop", "sstp")
CODE_LENGTH = 4
CRC_LENGTH = 2


class Command(IntEnum):
    """The last command that moved something, from ``MvCmdSts``."""

    STOP = 5
    SOFT_STOP = 8


class MoveFlag(IntFlag):
    """The rest of ``MvCmdSts``."""

    COMMAND = 0x3F
    ERROR = 0x40
    RUNNING = 0x80


class StateFlag(IntFlag):
    """``Flags`` of the status."""

    IS_HOMED = 0x20
    ALARM = 0x40


class Edge(IntFlag):
    """``GPIOFlags`` of the status."""

    RIGHT = 0x1
    LEFT = 0x2


class EngineFlag(IntFlag):
    """``EngineFlags`` of the motor's settings."""

    ANTIPLAY = 0x8
    LIMIT_SPEED = 0x80


class HomeFlag(IntFlag):
    """``HomeFlags`` of the search for the reference."""

    FIRST_TO_THE_RIGHT = 0x1
    SECOND_TO_THE_RIGHT = 0x2
    SECOND = 0x4
    HALF_TURN = 0x8
    FAST = 0x100


HOME_STOPS = {"revolution": 1, "sync": 2, "limit": 3}
"""At bit 4 for the first stop, at bit 6 for the second."""

FAULTS = {
    0x80: "motor and encoder differ too much: it slipped or stalled",
    0x100: "its power stage is too hot",
    0x200: "the controller is too hot",
    0x400: "its supply voltage is too high",
    0x800: "its supply current is too high",
    0x8000: "it stands at the wrong limit switch: are they swapped?",
    0x10000: "its supply voltage is too low",
    0x20000: "its power stage has failed",
    0x100000: "the motor's windings differ: is it damaged?",
    0x200000: "its encoder has failed",
    0x800000: "the motor does not do what it is told",
    0x1000000: "its external input raises an alarm",
}
"""Status flags that are an alarm, in words."""


class Status(NamedTuple):
    """The values of ``gets``."""

    move_state: int
    command_state: int
    power_state: int
    encoder_state: int
    winding_state: int
    steps: int
    microsteps: int
    encoder: int
    speed: int
    microspeed: int
    power_current: int
    power_voltage: int
    usb_current: int
    usb_voltage: int
    temperature: int
    flags: int
    gpio: int
    free_commands: int


class Engine(NamedTuple):
    """The values of ``geng`` and ``seng``."""

    voltage: int
    current: int
    speed: int
    microspeed: int
    flags: int
    antiplay: int
    microstep_mode: int
    steps_per_turn: int
    peak_current: int


class Motion(NamedTuple):
    """The values of ``gmov`` and ``smov``."""

    speed: int
    microspeed: int
    acceleration: int
    deceleration: int
    antiplay_speed: int
    antiplay_microspeed: int
    flags: int


def crc16(data: bytes) -> int:
    """CRC-16/Modbus: start 0xFFFF, polynomial 0xA001."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def encode(code: str, values: tuple[int, ...] = ()) -> bytes:
    """The bytes of a message to the controller."""
    if code not in WRITES:
        return code.encode()
    layout, reserved = WRITES[code]
    payload = struct.pack(layout, *values) + RESERVED * reserved
    return code.encode() + payload + struct.pack("<H", crc16(payload))


def answer_length(code: str) -> int:
    """Bytes of the answer to a message."""
    return CODE_LENGTH + (struct.calcsize(READS[code]) + CRC_LENGTH if code in READS else 0)


def decode(code: str, answer: bytes) -> tuple[int | bytes, ...] | None:
    """The values of a whole answer; None when it is not the answer to ``code`` or its checksum is wrong."""
    if len(answer) != answer_length(code) or answer[:CODE_LENGTH] != code.encode():
        return None
    if code not in READS:
        return ()
    payload, crc = answer[CODE_LENGTH:-CRC_LENGTH], answer[-CRC_LENGTH:]
    if struct.unpack("<H", crc)[0] != crc16(payload):
        return None
    return struct.unpack(READS[code], payload)
