"""What a LabJack's source can be told: what could harm the rig is refused before anything is connected."""

import pytest
from pydantic import ValidationError

from drivers.pressure.labjack_t7 import LabJackT7Options, TransducerOptions
from drivers.pressure.manual import ManualPressureOptions
from drivers.registry import installed_drivers
from tests.drivers.pressure.rigs import REGULATOR, TRANSDUCER, settings

GOOD = settings("tcp://192.168.1.30:502", regulator=REGULATOR)


def test_calibrations_are_straight_lines():
    options = LabJackT7Options.model_validate({**GOOD, "regulator": {"volts_at_zero": 0.25, "volts_per_kpa": 0.25}})
    assert [options.transducer.pressure_kpa(volts) for volts in (0.5, 1.5, 4.5)] == [0.0, 5.0, 20.0]
    assert [options.regulator.volts(kpa) for kpa in (0.0, 4.0, 16.0)] == [0.25, 1.25, 4.25]
    assert [options.regulator.pressure_kpa(volts) for volts in (0.0, 0.25, 1.25)] == [0.0, 0.0, 4.0]


@pytest.mark.parametrize(
    ("pressure_kpa", "possible"), [(-1.0, True), (-1.01, False), (21.0, True), (21.01, False), (float("nan"), False)]
)
def test_a_transducer_can_read_a_little_beyond_its_range(pressure_kpa, possible):
    assert TransducerOptions.model_validate(TRANSDUCER).can_be(pressure_kpa) is possible


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"address": "/dev/ttyUSB0"}, "must be tcp://HOST:PORT"),
        ({"address": "tcp://192.168.1.30"}, "must be tcp://HOST:PORT"),
        ({"address": "tcp://192.168.1.30:0"}, "must be tcp://HOST:PORT"),
        ({"sample_rate_hz": 49.0}, "greater than or equal to 50"),
        ({"range_v": 5.0}, "must be one of 10, 1, 0.1, 0.01"),
        ({"limits_kpa": (0.0, 25.0)}, "must lie in the transducer's range_kpa 0 to 20"),
        ({"limits_kpa": (16.0, 0.0)}, "must be low, then high"),
        ({"regulator": {"volts_per_kpa": 0.5}}, "16 kPa needs 8 V of DAC0"),
        ({"regulator": {"volts_per_kpa": 0.25, "volts_at_zero": -0.1}}, "0 kPa needs -0.1 V of DAC0"),
        ({"ceiling_kpa": 16.0}, "must lie above the limits' 16"),
        ({"ceiling_kpa": 21.5}, "beyond what the transducer can read"),
        ({"transducer": {**TRANSDUCER, "kpa_per_volt": 0.0}}, "must not be 0"),
        ({"transducer": {**TRANSDUCER, "serial": ""}}, "at least 1 character"),
        ({"watchdog_s": 1}, r"watchdog_s 1 must be 0 \(off\) or 2 to 3600"),
        ({"watchdog_s": -1}, r"must be 0 \(off\) or 2 to 3600"),
        ({"watchdog_s": 3601}, r"must be 0 \(off\) or 2 to 3600"),
        ({"watchdog_s": 2.5}, "valid integer"),
        ({"watchdog_s": 2, "answer_timeout_s": 1.0}, "longer than twice answer_timeout_s"),
        ({"celling_kpa": 17.0}, "Extra inputs"),
    ],
)
def test_refuses_what_can_not_be(changes, words):
    with pytest.raises(ValidationError, match=words):
        LabJackT7Options.model_validate({**GOOD, **changes})


@pytest.mark.parametrize(("changes", "watchdog_s"), [({}, 10), ({"watchdog_s": 0}, 0), ({"watchdog_s": 2}, 2)])
def test_the_t7_vents_by_itself_unless_told_not_to(changes, watchdog_s):
    assert LabJackT7Options.model_validate({**GOOD, **changes}).watchdog_s == watchdog_s


def test_a_source_turned_by_hand_has_no_regulator():
    with pytest.raises(ValidationError, match="Extra inputs"):
        ManualPressureOptions.model_validate(GOOD)


@pytest.mark.parametrize("name", ["pressure.labjack_t7", "pressure.manual"])
def test_is_known_by_name(name):
    entry = installed_drivers()[name]
    assert entry.kind == "pressure"
    assert entry.options.model_json_schema()["properties"]["transducer"]
