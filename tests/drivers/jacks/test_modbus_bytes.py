"""Every message the jacks' driver sends, byte by byte: Modbus RTU written out from the protocol table and the standard.

Unit 1 is the lower jack, unit 2 the upper one; 100 steps/mm; 2 mm/s = 200 steps/s = C8, 4 mm/s^2 = 400 = 190.
"""

import pytest

from drivers.clock import HostClock
from drivers.errors import (
    DeviceBusyError,
    DeviceFaultError,
    DeviceTimeoutError,
    NotHomedError,
    OutOfLimitsError,
    ProtocolError,
)
from drivers.jacks.modbus import ModbusJacks
from drivers.registry import DriverContext
from tests.drivers.crc_table import with_crc
from tests.drivers.jacks.rigs import options
from tests.drivers.modbus_peer import serial_peer, tcp_peer

HOMED, IDLE, MOVING, ALARM = "40 30", "40 20", "20 10", "00 90"


def rtu(request: str, answer: str) -> tuple[str, str]:
    return with_crc(request), with_crc(answer)


def outputs(unit: str, word: str) -> tuple[str, str]:
    return rtu(f"{unit} 03 00 7F 00 01", f"{unit} 03 02 {word}")


def position(unit: str, value: str) -> tuple[str, str]:
    return rtu(f"{unit} 03 00 CC 00 02", f"{unit} 03 04 {value}")


def state(unit: str, word: str, value: str) -> list[tuple[str, str]]:
    return [outputs(unit, word), position(unit, value)]


def both(word: str, value: str) -> list[tuple[str, str]]:
    return state("01", word, value) + state("02", word, value)


def command(word: str) -> list[tuple[str, str]]:
    return [rtu(f"{unit} 10 00 7D 00 01 02 {word}", f"{unit} 10 00 7D 00 01") for unit in ("01", "02")]


def move(unit: str, target: str) -> tuple[str, str]:
    values = f"00 00 00 00 00 00 00 01 {target} 00 00 00 C8 00 00 01 90 00 00 01 90 00 00 03 E8 00 00 00 01"
    return rtu(f"{unit} 10 00 58 00 10 20 {values}", f"{unit} 10 00 58 00 10")


AT_10_MM, AT_15_MM, AT_0_MM = "00 00 03 E8", "00 00 05 DC", "00 00 00 00"
RELEASE, ZHOME, STOP, ALM_RST = "00 00", "00 10", "00 20", "00 80"
BOTH_10, BOTH_15 = both(HOMED, AT_10_MM), both(HOMED, AT_15_MM)
STOPPED = command(STOP) + command(RELEASE)  # what close() sends at rest


def run(transcript, act, peer=serial_peer, **changes):
    with peer(transcript) as heard:
        settings = {"speed_mm_s": 2.0, "acceleration_mm_s2": 4.0, **changes}
        driver = ModbusJacks(options(heard.address, **settings), DriverContext("jack", HostClock()))
        try:
            driver.connect()
            act(driver)
        finally:
            driver.close()
    assert [message.hex(" ").upper() for message in heard.messages] == [request for request, _ in transcript]
    assert heard.beyond == b""


def test_the_checksum_is_the_standard_s():
    # Modbus over Serial Line 1.02, appendix B, and the catalogue's check value of CRC-16/MODBUS
    assert with_crc("02 07") == "02 07 41 12"
    assert with_crc(b"123456789".hex(" ")).endswith("37 4B")
    # CRCs that any Modbus calculator shows
    assert outputs("01", HOMED)[0] == "01 03 00 7F 00 01 B5 D2"


def test_connecting_reads_and_moves_nothing():
    run(BOTH_10 + STOPPED, lambda jacks: None)


def test_a_move():
    transcript = [
        *BOTH_10,
        *BOTH_10,
        *command(RELEASE),
        *BOTH_10,
        move("01", AT_15_MM),
        move("02", AT_15_MM),
        *both(MOVING, AT_10_MM),
        *BOTH_15,
        *command(RELEASE),
        *BOTH_15,
        *STOPPED,
    ]

    def act(jacks):
        jacks.move_to(30.0)
        status = jacks.status()
        assert (status.position, status.target, status.moving, status.homed) == (30.0, 30.0, False, True)

    run(transcript, act)


def test_a_move_is_split_as_configured():
    # lower jack first: 42 mm = 4200 steps = 1068, the upper one 8 mm = 800 steps = 320
    transcript = [
        *BOTH_10,
        *BOTH_10,
        *command(RELEASE),
        *BOTH_10,
        move("01", "00 00 10 68"),
        move("02", "00 00 03 20"),
        *state("01", HOMED, "00 00 10 68"),
        *state("02", HOMED, "00 00 03 20"),
        *command(RELEASE),
        *STOPPED,
    ]
    run(transcript, lambda jacks: jacks.move_to(50.0), lower_share=1.0)


def test_homing():
    transcript = [
        *both(IDLE, AT_10_MM),
        *both(IDLE, AT_10_MM),
        *command(RELEASE),
        *both(IDLE, AT_10_MM),
        *command(ZHOME),
        *both("20 00", "00 00 01 00"),
        *both(HOMED, AT_0_MM),
        *command(RELEASE),
        *STOPPED,
    ]
    run(transcript, lambda jacks: jacks.home())


def test_stopping_at_rest():
    run(BOTH_10 + STOPPED + STOPPED, lambda jacks: jacks.stop())


def test_a_position_below_zero_is_read_as_one():
    def act(jacks):
        assert jacks.status().position == -0.02

    run(BOTH_10 + both(HOMED, "FF FF FF FF") + STOPPED, act)


def test_an_alarm_is_told_in_words_and_reset_by_the_next_move():
    alarm = rtu("01 03 00 80 00 02", "01 03 04 00 00 00 30")
    alarmed = [outputs("01", ALARM), alarm, position("01", AT_10_MM), *state("02", HOMED, AT_10_MM)]
    reset = [
        rtu("01 10 00 7D 00 01 02 00 80", "01 10 00 7D 00 01"),
        rtu("01 10 00 7D 00 01 02 00 00", "01 10 00 7D 00 01"),
    ]
    transcript = [
        *BOTH_10,
        *alarmed,
        *alarmed,
        *command(RELEASE),
        *alarmed[:3],
        *reset,
        *alarmed[:3],
        *STOPPED,
    ]

    def act(jacks):
        assert jacks.status().fault == "lower jack: overload: the motor stalled (alarm 0x30)"
        with pytest.raises(DeviceFaultError, match=r"jack: moving to 30 mm: lower jack: overload.*free the jack"):
            jacks.move_to(30.0)

    run(transcript, act)


@pytest.mark.parametrize("position_mm", [-0.01, 84.01, float("nan"), float("inf"), -float("inf")])
def test_a_move_outside_the_limits_sends_not_a_byte(position_mm):
    def act(jacks):
        with pytest.raises(OutOfLimitsError, match=r"jack: .*choose a height from 0 to 84 mm"):
            jacks.move_to(position_mm)
        with pytest.raises(OutOfLimitsError):
            jacks.move_duration_s(position_mm)

    run(BOTH_10 + STOPPED, act)


def test_a_move_before_homing_sends_no_command():
    def act(jacks):
        with pytest.raises(NotHomedError):
            jacks.move_to(30.0)

    run(2 * both(IDLE, AT_10_MM) + STOPPED, act)


def test_jacks_that_another_moves_are_busy():
    def act(jacks):
        with pytest.raises(DeviceBusyError, match="moves already"):
            jacks.move_to(30.0)

    run(BOTH_10 + both(MOVING, AT_10_MM) + STOPPED, act)


@pytest.mark.parametrize(
    ("code", "error", "words"),
    [
        ("02", ProtocolError, "no such register"),
        ("04", DeviceFaultError, "could not do it"),
        ("06", DeviceBusyError, "busy"),
        ("0B", DeviceTimeoutError, "gateway"),
        ("63", ProtocolError, "exception 99"),
    ],
)
def test_a_refusal_is_told_in_words(code, error, words):
    def act(jacks):
        with pytest.raises(error, match=words):
            jacks.status()

    run([*BOTH_10, rtu("01 03 00 7F 00 01", f"01 83 {code}"), *STOPPED], act)


def test_modbus_tcp_carries_the_same_without_the_checksum():
    def framed(number: int, pair: tuple[str, str]) -> tuple[str, str]:
        bare = [message[:-6] for message in pair]
        heads = [f"{number >> 8:02X} {number & 255:02X} 00 00 00 {len(bytes.fromhex(part)):02X}" for part in bare]
        return f"{heads[0]} {bare[0]}", f"{heads[1]} {bare[1]}"

    serial = [*BOTH_10, *BOTH_10, *command(RELEASE), *BOTH_10, move("01", AT_15_MM), move("02", AT_15_MM)]
    serial += [*BOTH_15, *command(RELEASE), *STOPPED]
    transcript = [framed(number, pair) for number, pair in enumerate(serial, start=1)]
    assert transcript[0][0] == "00 01 00 00 00 06 01 03 00 7F 00 01"
    assert transcript[14][0].startswith("00 0F 00 00 00 27 01 10 00 58 00 10 20 00 00 00 00 00 00 00 01 00 00 05 DC")
    run(transcript, lambda jacks: jacks.move_to(30.0), peer=tcp_peer)


def test_a_late_answer_is_not_taken_for_the_next_one():
    """The answer to the read of the outputs (its word is 03E8) comes when the position is asked for."""
    late = with_crc("01 03 02 40 30")
    echo = "01 08 00 00 5A 01"
    transcript = [
        *BOTH_10,
        (with_crc("01 03 00 7F 00 01"), ""),
        (with_crc(echo), f"{late} {with_crc(echo)}"),
        (with_crc("01 08 00 00 5A 02"), with_crc("01 08 00 00 5A 02")),
        *BOTH_15,
        *STOPPED,
    ]

    def act(jacks):
        with pytest.raises(DeviceTimeoutError, match=r"asking for its status.*no answer within 1\.5 s"):
            jacks.status()
        assert jacks.status().position == 30.0

    run(transcript, act, answer_timeout_s=1.5)


def test_a_drive_that_does_not_know_the_echo_is_in_step_when_it_refuses_it():
    transcript = [
        *BOTH_10,
        (with_crc("01 03 00 7F 00 01"), ""),
        (with_crc("01 08 00 00 5A 01"), with_crc("01 88 01")),
        *BOTH_15,
        *STOPPED,
    ]

    def act(jacks):
        with pytest.raises(DeviceTimeoutError):
            jacks.status()
        assert jacks.status().position == 30.0

    run(transcript, act, answer_timeout_s=1.5)
