"""Every Zaber message that we send, byte by byte as Zaber's own library sends it."""

import math
import re
from contextlib import suppress

import pytest
from zaber_motion.ascii import Connection
from zaber_motion.exceptions import CommandFailedException

from drivers.errors import NotHomedError, OutOfLimitsError
from drivers.stages.zaber.messages import check_digits, decode, encode
from tests.drivers.stages.recording import recorded, zaber_session
from tests.drivers.stages.rigs import MICROSTEPS_PER_UNIT, zaber_axis

# recorded from zaber-motion 10.3.0, in this order; `test_these_are_the_makers_bytes` records them again
RECORDED = (
    b"/1 0 00 set comm.checksum 1:F5\n",
    b"/1 0 01 get deviceid:41\n",
    b"/1 0 02 get version:77\n",
    b"/1 0 03 get system.serial:29\n",
    b"/1 1 04 get limit.min:E9\n",
    b"/1 1 05 get limit.max:E6\n",
    b"/1 1 06 get maxspeed:21\n",
    b"/1 1 07 set maxspeed 1376079:83\n",
    b"/1 1 08 get accel:7E\n",
    b"/1 1 09 set accel 550:B7\n",
    b"/1 1 10 get pos:2B\n",
    b"/1 1 11 warnings:73\n",
    b"/1 1 12 warnings clear:4B\n",
    b"/1 1 13 home:31\n",
    b"/1 1 14 move abs 209974:6D\n",
    b"/1 1 15 stop:12\n",
)


def taken(recording) -> tuple[bytes, ...]:
    """What was said, a message each; looks at a motion and the numbers of messages taken out of it."""
    heard = recording.taken().splitlines(keepends=True)
    return tuple(line for line in heard if b" get pos:" not in line)


def words(messages) -> list[str]:
    return [re.sub(rb"^/(\d \d) \d\d (.*):..\n$", rb"\1 \2", message).decode() for message in messages]


def test_these_are_the_makers_bytes():
    with recorded(zaber_session()) as (address, recording):
        host, _, port = address.removeprefix("tcp://").partition(":")
        with Connection.open_tcp(host, int(port)) as connection:
            device = connection.get_device(1)
            for message in words(RECORDED):
                _, axis, command = message.split(" ", 2)
                with suppress(CommandFailedException):  # a move that is ordered during homing
                    (device if axis == "0" else device.get_axis(1)).generic_command(command)
        assert recording.taken().splitlines(keepends=True) == list(RECORDED)


@pytest.mark.parametrize("message", RECORDED, ids=lambda message: words([message])[0])
def test_ours_are_the_same(message):
    device, axis, number, command = message[1:-4].decode().split(" ", 3)
    assert encode(int(device), int(axis), int(number), command) == message


def test_the_check_digits_are_the_manuals():
    assert check_digits("1 1 14 move abs 50000") == "B7"
    assert encode(1, 1, 14, "move abs 50000") == b"/1 1 14 move abs 50000:B7\n"


def test_a_whole_session():
    with recorded(zaber_session()) as (address, recording):
        axis = zaber_axis("mm", address, speed=1376079 / 1.6384 / MICROSTEPS_PER_UNIT["mm"])
        axis.connect()
        heard = recording.taken().splitlines(keepends=True)
        assert heard[:10] == [*RECORDED[:9], encode(1, 1, 9, "get pos")]
        recording.taken()

        with pytest.raises(NotHomedError):
            axis.move_to(1.0)
        assert words(taken(recording)) == ["1 1 warnings"]

        axis.home()
        assert words(taken(recording))[:6] == [
            *("1 1 warnings", "1 1 warnings clear", "1 1 get maxspeed", "1 1 get accel", "1 1 home", "1 1 warnings")
        ]

        for position in (-0.001, 100.001, math.nan, math.inf):
            with pytest.raises(OutOfLimitsError):
                axis.move_to(position)
            with pytest.raises(OutOfLimitsError):
                axis.move_duration_s(position)
        axis.info()
        assert recording.taken() == b""

        axis.move_to(10.0)
        assert words(taken(recording)) == [
            *("1 1 warnings clear", "1 1 get maxspeed", "1 1 get accel", "1 1 move abs 209974")
        ]
        assert axis.status().position == pytest.approx(10.0, abs=0.5 * 0.047625e-3)
        recording.taken()
        axis.close()
        assert words(taken(recording)) == ["1 1 stop"]


def test_an_axis_that_is_reversed_and_does_not_begin_at_zero():
    with recorded(zaber_session()) as (address, recording):
        axis = zaber_axis("mm", address, reversed=True, limits=(-60.0, 40.0), home_position=40.0)
        axis.connect()
        axis.home()
        assert axis.status().position == pytest.approx(40.0, abs=0.5 * 0.047625e-3)
        axis.move_to(30.0)
        assert words(taken(recording))[-1] == "1 1 move abs 209974"
        assert axis.status().position == pytest.approx(30.0, abs=0.5 * 0.047625e-3)
        axis.close()


@pytest.mark.parametrize(
    "line",
    [
        b"@01 1 14 OK BUSY WR 0",
        b"@01 1 14 OK BUSY WR 0:00",
        b"@01 1 14 OK BUSY WR 1:08",
        b"#01 1 14 OK BUSY WR 0:08",
        b"@01 1 14 OK BUSY",
        b"@01 1 14 OK LAZY WR 0:08",
        b":",
        b"",
        bytes(range(128, 256)),
    ],
)
def test_what_is_no_reply(line):
    assert decode(line) is None


def test_a_reply_with_and_without_check_digits():
    body = b"@01 1 14 OK BUSY WR 0"
    checked = body + b":" + check_digits(body[1:].decode()).encode()
    reply = decode(checked + b"\r")
    assert reply == decode(body, unchecked=True)
    assert reply is not None
    assert (reply.address, reply.axis, reply.message_id) == (1, 1, 14)
    assert (reply.accepted, reply.busy, reply.flag, reply.data) == (True, True, "WR", "0")
