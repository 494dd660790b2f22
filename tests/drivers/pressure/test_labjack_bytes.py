"""Every message sent to the LabJack, byte by byte: Modbus TCP written out from the protocol table and the standard.

55100 = D73C, 60000 = EA60, 60004 = EA64, 60028 = EA7C, 40000 = 9C40, 41000 = A028, 41500 = A21C, 42000 = A410,
1000 = 03E8; the watchdog's 61600 = F0A0, 61602 = F0A2, 61604 = F0A4, 61610 = F0AA, 61620 = F0B4, 61640 = F0C8,
61642 = F0CA (LabJack's Modbus map); floats are IEEE 754, upper word first: 7.0 = 40E00000, 10.0 = 41200000,
1.5 = 3FC00000, 3.125 = 40480000.
"""

import pytest

from drivers.clock import HostClock
from drivers.errors import DeviceFaultError, NotConnectedError, ProtocolError, UnsupportedError
from drivers.pressure.labjack_t7 import InputOptions
from drivers.pressure.labjack_t7.device import LabJackT7
from drivers.pressure.labjack_t7.watchdog import Watchdog
from tests.drivers.modbus_peer import tcp_peer
from tests.drivers.pressure.rigs import settings

TEST = ("01 03 D7 3C 00 02", "01 03 04 00 11 22 33")
PRODUCT = ("01 03 EA 60 00 02", "01 03 04 40 E0 00 00")
SERIAL = ("01 03 EA 7C 00 02", "01 03 04 1C 03 CD B9")
FIRMWARE = ("01 03 EA 64 00 02", "01 03 04 3F 83 FE 5D")
SET_UP = [
    ("01 10 9C 40 00 02 04 41 20 00 00", "01 10 9C 40 00 02"),
    ("01 10 A0 28 00 01 02 00 C7", "01 10 A0 28 00 01"),
    ("01 10 A2 1C 00 01 02 00 00", "01 10 A2 1C 00 01"),
    ("01 10 A4 10 00 02 04 00 00 00 00", "01 10 A4 10 00 02"),
]
GREETING = [TEST, PRODUCT, SERIAL, FIRMWARE, *SET_UP]


def ain0(volts: str) -> tuple[str, str]:
    return "01 03 00 00 00 02", f"01 03 04 {volts}"


def dac0(volts: str) -> tuple[str, str]:
    return "01 03 03 E8 00 02", f"01 03 04 {volts}"


def set_dac0(volts: str) -> tuple[str, str]:
    return f"01 10 03 E8 00 02 04 {volts}", "01 10 03 E8 00 02"


def run(transcript, act, **changes):
    framed = [
        tuple(f"00 {number:02X} 00 00 00 {len(bytes.fromhex(part)):02X} {part}" for part in pair)
        for number, pair in enumerate(transcript, start=1)
    ]
    with tcp_peer(framed) as heard:
        labjack = LabJackT7(
            "pressure",
            InputOptions.model_validate(settings(heard.address, answer_timeout_s=3.0, **changes)),
            HostClock(),
        )
        try:
            act(labjack)
        finally:
            labjack.line.close()
    assert [message.hex(" ").upper() for message in heard.messages] == [request for request, _ in framed]
    assert heard.beyond == b""


def opened(labjack):
    labjack.line.open()
    return labjack


def test_connecting_asks_who_is_there_and_sets_the_input_up():
    def act(labjack):
        opened(labjack)
        assert labjack.serial == "470011321"
        assert labjack.firmware == "1.0312"

    run(GREETING, act)


def test_another_input_is_set_up_as_configured():
    # channel 3: range at 40006 = 9C46, 1 V; negative channel 4 at 41003; resolution 8 at 41503; 200 us at 42006
    set_up = [
        ("01 10 9C 46 00 02 04 3F 80 00 00", "01 10 9C 46 00 02"),
        ("01 10 A0 2B 00 01 02 00 04", "01 10 A0 2B 00 01"),
        ("01 10 A2 1F 00 01 02 00 08", "01 10 A2 1F 00 01"),
        ("01 10 A4 16 00 02 04 43 48 00 00", "01 10 A4 16 00 02"),
    ]

    def act(labjack):
        assert opened(labjack).volts("reading")[0] == 0.75

    transcript = [TEST, PRODUCT, SERIAL, FIRMWARE, *set_up, ("01 03 00 06 00 02", "01 03 04 3F 40 00 00")]
    run(transcript, act, channel=3, range_v=1.0, negative_channel=4, resolution_index=8, settling_us=200.0)


def test_reading_the_transducer():
    def act(labjack):
        began_s = HostClock().now_s()
        volts, time_s = opened(labjack).volts("reading")
        assert volts == 1.5
        assert began_s < time_s < HostClock().now_s()

    run([*GREETING, ain0("3F C0 00 00")], act)


def test_setting_the_regulator_and_reading_it_back():
    def act(labjack):
        opened(labjack).set_dac_volts(3.125, "setting")

    run([*GREETING, set_dac0("40 48 00 00"), dac0("40 48 00 00")], act)


def test_venting_is_zero_volts_that_are_read_back():
    def act(labjack):
        opened(labjack).set_dac_volts(0.0, "venting")

    run([*GREETING, set_dac0("00 00 00 00"), dac0("00 00 00 00")], act)


def test_an_output_that_stays_elsewhere_is_a_fault():
    def act(labjack):
        with pytest.raises(DeviceFaultError, match=r"pressure: venting: DAC0 was set to 0 V and reads 3\.125 V"):
            opened(labjack).set_dac_volts(0.0, "venting")

    run([*GREETING, set_dac0("00 00 00 00"), dac0("40 48 00 00")], act)


@pytest.mark.parametrize("volts", ["7F C0 00 00", "7F 80 00 00", "C1 80 00 00"])
def test_volts_that_no_input_reads_are_no_reading(volts):
    """NaN, infinity, -16 V."""

    def act(labjack):
        with pytest.raises(ProtocolError, match="outside the input's range"):
            opened(labjack).volts("reading")

    run([*GREETING, ain0(volts)], act)


@pytest.mark.parametrize(
    ("transcript", "words"),
    [
        ([("01 03 D7 3C 00 02", "01 03 04 22 33 00 11")], "0x22330011, so it is no LabJack"),
        ([TEST, ("01 03 EA 60 00 02", "01 03 04 40 80 00 00")], "a T4, not a T7"),
        ([TEST, PRODUCT, SERIAL, FIRMWARE], "serial number 470011321, not 470000000"),
    ],
)
def test_another_device_is_refused(transcript, words):
    def act(labjack):
        with pytest.raises(NotConnectedError, match=words):
            opened(labjack)
        assert not labjack.line.is_open

    run(transcript, act, serial_number=470000000)


def told(address: str, value: str) -> tuple[str, str]:
    return f"01 03 {address} 00 02", f"01 03 04 {value}"


def write(address: str, value: str) -> tuple[str, str]:
    return f"01 10 {address} 00 02 04 {value}", f"01 10 {address} 00 02"


ENABLED, DISABLED = told("F0 A0", "00 00 00 01"), told("F0 A0", "00 00 00 00")
ENABLE, DISABLE = write("F0 A0", "00 00 00 01"), write("F0 A0", "00 00 00 00")
FROM_THE_FACTORY = [
    told("F0 A2", "00 00 00 00"),
    told("F0 A4", "00 00 00 00"),
    told("F0 AA", "00 00 00 00"),
    told("F0 B4", "00 00 00 00"),
    told("F0 C8", "00 00 00 00"),
    told("F0 CA", "00 00 00 00"),
]
AS_WANTED = [
    FROM_THE_FACTORY[0],
    told("F0 A4", "00 00 00 0A"),
    *FROM_THE_FACTORY[2:4],
    told("F0 C8", "00 00 00 01"),
    FROM_THE_FACTORY[5],
]
OTHERWISE = [
    told("F0 A2", "00 00 00 02"),
    told("F0 A4", "00 00 00 3C"),
    told("F0 AA", "00 00 00 01"),
    told("F0 B4", "00 00 00 01"),
    told("F0 C8", "00 00 00 00"),
    told("F0 CA", "40 00 00 00"),
]
CORRECTED = [
    write("F0 A2", "00 00 00 00"),
    write("F0 A4", "00 00 00 0A"),
    write("F0 AA", "00 00 00 00"),
    write("F0 B4", "00 00 00 00"),
    write("F0 C8", "00 00 00 01"),
    write("F0 CA", "00 00 00 00"),
]


@pytest.mark.parametrize(
    "transcript",
    [
        pytest.param([ENABLED, *AS_WANTED], id="as it should be: nothing is written"),
        pytest.param([DISABLED, *AS_WANTED, ENABLE, ENABLED, *AS_WANTED], id="only to be enabled"),
        pytest.param(
            [DISABLED, *FROM_THE_FACTORY, CORRECTED[1], CORRECTED[4], ENABLE, ENABLED, *AS_WANTED],
            id="from the factory",
        ),
        pytest.param(
            [ENABLED, *OTHERWISE, DISABLE, *CORRECTED, ENABLE, ENABLED, *AS_WANTED],
            id="set otherwise, and running: disabled first",
        ),
    ],
)
def test_arming_writes_what_differs_in_labjack_s_order(transcript):
    def act(labjack):
        watchdog = Watchdog("pressure", opened(labjack), 10)
        watchdog.arm("setting 4 kPa")
        watchdog.arm("setting 5 kPa")
        watchdog.disarm("closing")
        watchdog.disarm("closing")

    run([*GREETING, *transcript, DISABLE], act)


def test_no_watchdog_sends_nothing():
    def act(labjack):
        watchdog = Watchdog("pressure", opened(labjack), 0)
        watchdog.arm("setting 4 kPa")
        watchdog.disarm("closing")

    run(GREETING, act)


@pytest.mark.parametrize("code", [1, 2, 3, 4])
def test_a_watchdog_that_is_refused_is_not_there(code):
    def act(labjack):
        watchdog = Watchdog("pressure", opened(labjack), 10)
        with pytest.raises(UnsupportedError, match=r"setting 4 kPa: its firmware 1\.0312 .*set watchdog_s = 0"):
            watchdog.arm("setting 4 kPa")
        assert not watchdog.is_armed

    run([*GREETING, ("01 03 F0 A0 00 02", f"01 83 {code:02X}")], act)


def test_a_garbled_answer_does_not_tell_that_there_is_no_watchdog():
    def act(labjack):
        watchdog = Watchdog("pressure", opened(labjack), 10)
        with pytest.raises(ProtocolError, match=r"another question|garbled"):
            watchdog.arm("setting 4 kPa")

    run([*GREETING, ("01 03 F0 A0 00 02", "01 04 04 00 00 00 01")], act)


def test_a_watchdog_that_does_not_keep_its_settings_is_a_fault():
    def act(labjack):
        with pytest.raises(DeviceFaultError, match="does not keep what it is set to; look what else writes to it"):
            Watchdog("pressure", opened(labjack), 10).arm("setting 4 kPa")

    run([*GREETING, DISABLED, *AS_WANTED, ENABLE, DISABLED], act)
