"""What must hold for any position and any bytes, with the driver's framing on one side, the emulator's on the other."""

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.stages.ximc.controller import in_steps
from drivers.stages.ximc.messages import Status, answer_length, crc16, decode, encode
from drivers.stages.zaber.messages import decode as decode_reply
from drivers.stages.zaber.messages import encode as encode_message
from tests.drivers.stages.recording import ximc_session, zaber_session

DIVISIONS = st.sampled_from([1, 2, 4, 8, 16, 32, 64, 128, 256])
COUNTS = st.integers(-(2**31) * 100, 2**31 * 100)


def answer(session, message: bytes) -> bytes:
    return b"".join(session.receive(message))


@given(DIVISIONS, COUNTS)
def test_a_position_goes_to_the_controller_and_back_unchanged(division, count):
    count = max(min(count, (2**31 - 1) * division), -(2**31 - 1) * division)
    session = ximc_session()
    mode = division.bit_length()
    engine = encode("seng", (2400, 670, 5000, 0, 0, 0, mode, 200, 0))
    assert answer(session, engine) == b"seng"
    assert answer(session, encode("spos", (*in_steps(count, division), 0, 2))) == b"spos"
    values = decode("gets", answer(session, b"gets"))
    assert values is not None
    status = Status(*(int(value) for value in values))
    assert status.steps * division + status.microsteps == count
    assert abs(status.microsteps) < division


@given(COUNTS, DIVISIONS)
def test_steps_and_microsteps_have_one_sign(count, division):
    steps, rest = in_steps(count, division)
    assert steps * division + rest == count
    assert abs(rest) < division
    assert steps * count >= 0 and rest * count >= 0


@settings(deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=6))
def test_zeros_bring_an_ximc_controller_into_step_after_any_bytes(pieces):
    session = ximc_session()
    for piece in pieces:
        answer(session, piece)
    assert b"\0" in answer(session, bytes(64))
    reply = answer(session, encode("gser"))
    assert decode("gser", reply[-answer_length("gser") :]) == (4711,)
    assert decode("gser", answer(session, b"gser")) == (4711,)


@settings(deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=6))
def test_a_new_line_brings_zaber_devices_into_step_after_any_bytes(pieces):
    session = zaber_session()
    for piece in pieces:
        answer(session, piece)
    answer(session, b"\n")
    answer(session, encode_message(1, 0, 41, "set comm.checksum 1"))
    reply = decode_reply(answer(session, encode_message(1, 0, 42, "get system.serial")).strip())
    assert reply is not None
    assert (reply.message_id, reply.data) == (42, "4711")


@given(st.integers(0, 47), st.integers(1, 255))
def test_no_answer_with_a_wrong_byte_is_taken(place, change):
    right = answer(ximc_session(), b"gets")
    wrong = bytearray(right)
    wrong[4 + place] ^= change
    assert decode("gets", right) is not None
    assert decode("gets", bytes(wrong)) is None
    reply = b"@01 1 14 OK BUSY WR 1234"
    line = reply + b":%02X" % (-sum(reply[1:]) % 256)
    place %= len(line)
    wrong = bytearray(line)
    wrong[place] ^= change
    assert decode_reply(line) is not None
    assert decode_reply(bytes(wrong)) is None


@given(st.binary(max_size=64))
def test_both_sides_know_the_same_checksum(payload):
    """Each has its own way to compute it."""
    message = b"spos" + payload[:20].ljust(20, b"\0")
    message += struct.pack("<H", crc16(message[4:]))
    assert answer(ximc_session(), message) == b"spos"
    assert answer(ximc_session(), message[:-1] + bytes([message[-1] ^ 1])) == b"errd"
