"""The register map is a file: the shipped one is the protocol table's, a copy can be changed, a wrong one is no map."""

import pytest
from pydantic import ValidationError

from drivers.jacks.modbus import ModbusJacksOptions, load_register_map, shipped_maps
from drivers.jacks.modbus.register_map import MAPS
from drivers.registry import installed_drivers
from tests.drivers.jacks.rigs import jack_rig

SHIPPED = (MAPS / "oriental-az.toml").read_text()


def test_the_shipped_map_is_the_protocol_table():
    assert shipped_maps() == ["oriental-az"]
    az = load_register_map("oriental-az")
    assert (az.vendor, az.model, az.word_order) == ("Oriental Motor", "AZ", "big")
    assert az.move.address == 0x0058
    assert az.move.values == (0, 1, "position", "speed", "acceleration", "deceleration", 1000, 1)
    assert (az.inputs.address, az.inputs.release) == (0x007D, 0)
    assert (az.inputs.home, az.inputs.stop, az.inputs.alarm_reset) == (1 << 4, 1 << 5, 1 << 7)
    assert (az.outputs.address, az.outputs.homed, az.outputs.alarm, az.outputs.moving) == (
        0x007F,
        1 << 4,
        1 << 7,
        1 << 13,
    )
    assert (az.position.address, az.alarm.address) == (0x00CC, 0x0080)
    assert az.alarm.meaning(0x66) == "limit switch hit (alarm 0x66)"
    assert az.alarm.meaning(0x99) == "an alarm that the register map does not name (alarm 0x99)"


def test_a_copy_can_be_changed(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(SHIPPED.replace('vendor = "Oriental Motor"', 'vendor = "Mine"'))
    with jack_rig("tcp", register_map=str(file)) as rig:
        rig.ready().move_to(6.0)
        assert rig.driver.info().vendor == "Mine"
        assert rig.truth_mm() == pytest.approx(6.0, abs=0.02)
    assert load_register_map(str(file)).move == load_register_map("oriental-az").move


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("address = 0x0058", "address = 0x10058", "less than or equal to 65535"),
        ('"position", ', "", "must hold"),
        ('"position", "speed"', '"position", "velocity"', "move.values"),
        ("home = ", "homing = ", "inputs.home"),
        ("moving = 0x2000", "moving = 0", "outputs.moving"),
        ('0x10 = "excessive', 'ten = "excessive', "invalid literal"),
        ('word_order = "big"', 'word_order = "middle"', "word_order"),
        ("[move]", "[move", "register map .*Expected"),
    ],
)
def test_refuses_a_wrong_map(tmp_path, old, new, words):
    file = tmp_path / "wrong.toml"
    assert old in SHIPPED
    file.write_text(SHIPPED.replace(old, new, 1))
    with pytest.raises(ValueError, match=words):
        load_register_map(str(file))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"register_map": "oriental-ar"}, "no register map 'oriental-ar'; shipped: oriental-az"),
        ({"register_map": "/nowhere/mine.toml"}, "No such file"),
        ({"address": "COM3"}, "must be tcp://HOST:PORT or a serial port's path"),
        ({"lower": {"unit": 2}}, "both drives have the address 2"),
        ({"lower": {"unit": 0}}, "greater than or equal to 1"),
        ({"upper": {"unit": 2, "limits_mm": (42.0, 0.0)}}, "must be low, then high"),
        (
            {"lower": {"unit": 1, "limits_mm": (5.0, 42.0)}},
            r"lower\n.* height_at_zero_mm = 0, where homing ends, must lie in limits_mm, 5 to 42: widen the limits",
        ),
        (
            {"upper": {"unit": 2, "limits_mm": (0.0, 42.0), "height_at_zero_mm": 42.1}},
            r"upper\n.*= 42\.1, where",
        ),
        ({"upper": {"unit": 2, "limits_mm": (-9.0, -1.0)}}, "height_at_zero_mm = 0, where homing ends"),
        ({"speed_mm_s": 0.0}, "greater than 0"),
        ({"serial": {"parity": "mark"}}, "'none', 'even' or 'odd'"),
        ({"adress": "/dev/ttyUSB0"}, "Extra inputs"),
    ],
)
def test_refuses_wrong_options(changes, words):
    with pytest.raises(ValidationError, match=words):
        ModbusJacksOptions.model_validate({"address": "/dev/ttyUSB0", **changes})


def test_the_two_jacks_of_the_rig_are_the_default():
    options = ModbusJacksOptions.model_validate({"address": "/dev/ttyUSB0"})
    assert (options.limits_mm.low, options.limits_mm.high) == (0.0, 84.0)
    assert [jack.unit for jack in options.jacks] == [1, 2]
    assert (options.serial.baudrate, options.serial.parity, options.serial.stopbits) == (115200, "even", 1)


@pytest.mark.parametrize("height_mm", [5.0, 20.0, 42.0])
def test_a_jack_may_home_anywhere_within_its_limits(height_mm):
    lower = {"unit": 1, "limits_mm": (5.0, 42.0), "height_at_zero_mm": height_mm}
    options = ModbusJacksOptions.model_validate({"address": "/dev/ttyUSB0", "lower": lower})
    assert options.lower.height_mm(0) == height_mm


@pytest.mark.parametrize("name", ["axis.modbus", "axis.manual"])
def test_is_known_by_name(name):
    entry = installed_drivers()[name]
    assert entry.kind == "axis"
    assert entry.options.model_json_schema()["additionalProperties"] is False
