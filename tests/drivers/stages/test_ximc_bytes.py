"""Every XIMC message that we send, byte by byte as Standa's own library sends it."""

import math
import re
import struct

import libximc.highlevel as ximc
import pytest

from drivers.errors import NotHomedError, OutOfLimitsError
from drivers.stages.ximc.messages import PLAIN, READS, WRITES, crc16, encode
from tests.drivers.stages.recording import recorded, ximc_session
from tests.drivers.stages.rigs import ximc_axis

# recorded from libximc 3.1.1; `test_these_are_the_makers_bytes` records them again
MOVE = "6d6f7665a00f00001100ccccccccccccbcf1"
MOVE_BACK = "6d6f766560f0ffffefffcccccccccccc7d67"
SET_MOTION = "736d6f76a00f000080803e803ed00700004000cccccccccccccccccc020e"
SET_ENGINE = "73656e6760099e0288130000001800d8ff09c8000000cccccccccccccccccccc8e12"
SET_HOMING = "73686f6d401f000000200300008038ffffffc0fff701cccccccccccccccccc7366"
SET_POSITION = "73706f736073ffff80ff000000000000000002cccccccccca7f0"

VALUES = {
    MOVE: ("move", (4000, 17)),
    MOVE_BACK: ("move", (-4000, -17)),
    SET_MOTION: ("smov", (4000, 128, 16000, 16000, 2000, 64, 0)),
    SET_ENGINE: ("seng", (2400, 670, 5000, 0, 0x18, -40, 9, 200, 0)),
    SET_HOMING: ("shom", (8000, 0, 800, 128, -200, -64, 0x1F7)),
    SET_POSITION: ("spos", (-36000, -128, 0, 2)),
}
"""The same in numbers: 4000.5 steps/s, 16000 steps/s^2, 40 steps of play, 200.25 steps to the left, ..."""

OPTIONS = {
    "limits": (-100.0, 100.0),
    "speed": 4000.5 / 400.0,
    "acceleration": 16000 / 400.0,
    "backlash": -40 / 400.0,
    "backlash_speed": 2000.25 / 400.0,
    "homing": {
        "direction": "right",
        "second": True,
        "fast_algorithm": True,
        "fast_speed": 8000 / 400.0,
        "slow_speed": 800.5 / 400.0,
        "shift": -200.25 / 400.0,
        "position": -36000.5 / 400.0,
    },
}
"""The same in the driver's terms, for 400 steps/mm."""


def by_the_maker(axis: ximc.Axis, message: str) -> None:
    code, values = VALUES[message]
    if code == "move":
        axis.command_move(*values)
    elif code == "spos":
        axis.set_position(ximc.set_position_t(*values[:3], ximc.PositionFlags(values[3])))
    elif code == "smov":
        motion = axis.get_move_settings()
        motion.Speed, motion.uSpeed, motion.Accel, motion.Decel = values[:4]
        motion.AntiplaySpeed, motion.uAntiplaySpeed = values[4:6]
        axis.set_move_settings(motion)
    elif code == "seng":
        engine = axis.get_engine_settings()
        engine.EngineFlags, engine.Antiplay = ximc.EngineFlags(values[4]), values[5]
        axis.set_engine_settings(engine)
    else:
        homing = axis.get_home_settings()
        homing.FastHome, homing.uFastHome, homing.SlowHome, homing.uSlowHome = values[:4]
        homing.HomeDelta, homing.uHomeDelta, homing.HomeFlags = *values[4:6], ximc.HomeFlags(values[6])
        axis.set_home_settings(homing)


@pytest.mark.parametrize("message", VALUES, ids=lambda message: VALUES[message][0])
def test_these_are_the_makers_bytes(message):
    with recorded(ximc_session()) as (address, recording):
        axis = ximc.Axis(f"xi-{address}")
        axis.open_device()
        recording.taken()
        by_the_maker(axis, message)
        assert recording.taken().endswith(bytes.fromhex(message))
        axis.close_device()


def test_so_are_the_short_ones():
    calls = {
        "gets": "get_status",
        "gmov": "get_move_settings",
        "geng": "get_engine_settings",
        "geti": "get_device_information",
        "gser": "get_serial_number",
        "gfwv": "get_firmware_version",
        "gblv": "get_bootloader_version",
        "home": "command_home",
        "sstp": "command_sstp",
        "stop": "command_stop",
        "zero": "command_zero",
    }
    with recorded(ximc_session()) as (address, recording):
        axis = ximc.Axis(f"xi-{address}")
        axis.open_device()
        for code, call in calls.items():
            recording.taken()
            getattr(axis, call)()
            assert recording.taken() == encode(code)
        axis.close_device()
    assert set(calls) == set(READS) | set(PLAIN)


@pytest.mark.parametrize("message", VALUES, ids=lambda message: VALUES[message][0])
def test_ours_are_the_same(message):
    assert encode(*VALUES[message]).hex() == message


def test_no_message_is_left_out():
    assert {code for code, _ in VALUES.values()} == set(WRITES)


def test_the_checksum_is_that_of_the_standard():
    # the check value of CRC-16/MODBUS
    assert crc16(b"123456789") == 0x4B37
    # with its own CRC behind it, low byte first, any message has the checksum 0
    payload = bytes.fromhex(MOVE)[4:]
    assert crc16(payload) == 0
    assert struct.unpack("<H", payload[-2:])[0] == crc16(payload[:-2])


def transcript(recording) -> bytes:
    """What was said, any number of looks at a motion as one."""
    return re.sub(b"(gets)+", b"gets", recording.taken())


def test_a_whole_session():
    with recorded(ximc_session()) as (address, recording):
        axis = ximc_axis("mm", address, **OPTIONS)
        axis.connect()
        assert transcript(recording) == b"".join(
            (bytes(64), b"gser", b"geti", b"gser", b"gfwv")
            + (b"geng", bytes.fromhex(SET_ENGINE), b"geng", b"gmov", bytes.fromhex(SET_MOTION), b"gmov", b"gets")
        )

        with pytest.raises(NotHomedError):
            axis.move_to(1.0)
        assert transcript(recording) == b"gets"

        axis.home()
        asked = b"getsgenggmov"
        assert transcript(recording) == b"".join(
            (asked, bytes.fromhex(SET_HOMING), b"home", b"gets", bytes.fromhex(SET_POSITION), b"gets")
        )
        assert axis.status().position == -90.00125
        recording.taken()

        for position in (-100.001, 100.001, math.nan, math.inf):
            with pytest.raises(OutOfLimitsError):
                axis.move_to(position)
            with pytest.raises(OutOfLimitsError):
                axis.move_duration_s(position)
        axis.info()
        assert recording.taken() == b""

        # the recipe's reference is at -90.00125 mm: go there, where the emulated stage's travel begins
        axis.move_to(-90.0)
        assert transcript(recording) == asked + encode("move", (-36000, 0)) + b"gets"

        axis.close()
        assert transcript(recording) == b"sstpgets"


def test_a_reference_at_zero():
    with recorded(ximc_session()) as (address, recording):
        axis = ximc_axis("mm", address)
        axis.connect()
        axis.home()
        assert transcript(recording).endswith(b"homegetszerogets")
        axis.move_to(10.0 + 17 / 256 / 400.0)
        assert transcript(recording).endswith(bytes.fromhex(MOVE) + b"gets")
        axis.close()


def test_an_axis_that_is_reversed():
    with recorded(ximc_session()) as (address, recording):
        axis = ximc_axis("mm", address, reversed=True, limits=(-100.0, 0.0), backlash=0.1)
        axis.connect()
        assert struct.pack("<h", -40) in transcript(recording)
        axis.home()
        recording.taken()
        axis.move_to(-10.0 - 17 / 256 / 400.0)
        assert transcript(recording).endswith(bytes.fromhex(MOVE) + b"gets")
        assert axis.status().position == pytest.approx(-10.000166016, abs=1e-9)
        axis.close()
