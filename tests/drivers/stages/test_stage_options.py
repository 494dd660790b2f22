"""What stages can be told: by name, described, validated, and refused by the device where it does not fit."""

import pytest
from pydantic import ValidationError

from drivers.errors import NotConnectedError, UnsupportedError
from drivers.interfaces import Axis
from drivers.registry import DriverContext, installed_drivers
from tests.drivers.stages.rigs import serving, ximc_axis, ximc_emulator, ximc_options, zaber_axis, zaber_options

PORT = "/dev/serial/by-id/usb-XIMC"
BUILD = {"axis.ximc": ximc_options, "axis.zaber": zaber_options}
HOMING = {"fast_speed": 5.0, "slow_speed": 1.0}


@pytest.mark.parametrize("name", BUILD)
def test_is_built_by_its_name(name):
    entry = installed_drivers()[name]
    assert entry.kind == "axis"
    assert entry.summary
    axis = entry.build(BUILD[name]("mm", PORT), DriverContext("translation"))
    assert isinstance(axis, Axis)
    assert axis.name == "translation"
    assert not axis.status().connected


@pytest.mark.parametrize("name", BUILD)
def test_every_option_is_described(name):
    schema = installed_drivers()[name].options.model_json_schema()
    for model in (schema, *schema.get("$defs", {}).values()):
        assert model["additionalProperties"] is False
        assert all(option.get("description") for option in model["properties"].values())


@pytest.mark.parametrize("name", BUILD)
@pytest.mark.parametrize(
    "port",
    ["/dev/ttyUSB0", PORT, "tcp://127.0.0.1:7101", "tcp://stage.lab:65535", "tcp://[::1]:7101"],
)
def test_ports(name, port):
    assert installed_drivers()[name].options.model_validate(BUILD[name]("mm", port)).port == port


@pytest.mark.parametrize("name", BUILD)
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"port": "COM3"}, "must be the path of a port"),
        ({"port": "tcp://127.0.0.1"}, "must be tcp://HOST:PORT"),
        ({"port": "tcp://127.0.0.1:0"}, "must be tcp://HOST:PORT"),
        ({"port": "tcp://127.0.0.1:65536"}, "must be tcp://HOST:PORT"),
        ({"port": "udp://127.0.0.1:7101"}, "must be the path of a port"),
        ({"limits": [10.0, 10.0]}, "must be low, then high"),
        ({"limits": [0.0, float("inf")]}, "finite number"),
        ({"unit": "um"}, "'mm' or 'deg'"),
        ({"speed": 0.0}, "greater than 0"),
        ({"speed": 1e-9}, "less than"),
        ({"acceleration": -1.0}, "greater than 0"),
        ({"acceleration": 1e-6}, "acceleration"),
        ({"tolerance": -1.0}, "greater than or equal to 0"),
        ({"answer_timeout_s": 0.0}, "greater than 0"),
        ({"spead": 1.0}, "spead"),
    ],
)
def test_refuses(name, options, words):
    with pytest.raises(ValidationError) as raised:
        installed_drivers()[name].build({**BUILD[name]("mm", PORT), **options}, DriverContext("stage"))
    assert words in str(raised.value)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("axis.ximc", {"microsteps": 3}, "microsteps"),
        ("axis.ximc", {"steps_per_unit": 1e9}, "must be 1 to 65535 steps/s^2"),
        ("axis.ximc", {"limits": [0.0, 1e7]}, "beyond what the controller can count"),
        ("axis.ximc", {"backlash": 100.0}, "backlash = 100 must be 32767 steps at most"),
        ("axis.ximc", {"homing": {**HOMING, "position": -1.0}}, "homing.position = -1 must lie in the limits 0 to 100"),
        ("axis.ximc", {"homing": {**HOMING, "fast_speed": 1e-9}}, "homing.fast_speed = 1e-09 is less than a microstep"),
        ("axis.ximc", {"homing": {**HOMING, "stop_at": "wall"}}, "'limit', 'sync' or 'revolution'"),
        ("axis.zaber", {"address": 0}, "greater than or equal to 1"),
        ("axis.zaber", {"axis": 10}, "less than or equal to 9"),
        (
            "axis.zaber",
            {"limits": [10.0, 50.0]},
            "home_position = 0, where homing ends, must lie in the limits 10 to 50: widen the limits",
        ),
        (
            "axis.zaber",
            {"home_position": -0.1},
            "home_position = -0.1, where homing ends, must lie in the limits 0 to 100",
        ),
    ],
)
def test_refuses_what_its_maker_does_not_know(name, options, words):
    with pytest.raises(ValidationError) as raised:
        installed_drivers()[name].build({**BUILD[name]("mm", PORT), **options}, DriverContext("stage"))
    assert words in str(raised.value)


@pytest.fixture(scope="module")
def emulator():
    with serving(ximc_emulator("mm", "tcp")) as emulator:
        yield emulator


def engine(emulator, **fields: int) -> None:
    """Change the settings of the motor, as another program would."""
    names = ("voltage", "current", "speed", "microspeed", "flags", "antiplay", "microsteps", "turn", "peak")
    found = dict(zip(names, emulator.controller.read("geng"), strict=True))
    emulator.controller.write("seng", tuple({**found, **fields}.values()))


def test_a_motor_that_is_too_slow(emulator):
    engine(emulator, flags=0x80, speed=4000)
    axis = ximc_axis("mm", emulator.address, speed=10.1)
    with pytest.raises(UnsupportedError, match="nominal speed, 10 mm/s, is less"):
        axis.connect()
    assert not axis.status().connected
    axis = ximc_axis("mm", emulator.address, speed=10.0)
    axis.connect()
    axis.close()


def test_what_was_set_stays_but_for_what_is_asked(emulator):
    engine(emulator, current=123, peak=456, flags=0x18, antiplay=77, microsteps=5)
    axis = ximc_axis("mm", emulator.address, microsteps=256)
    axis.connect()
    axis.close()
    voltage, current, _, _, flags, antiplay, microsteps, turn, peak = emulator.controller.read("geng")
    assert (voltage, current, peak, turn) == (2400, 123, 456, 200)
    assert (flags, antiplay, microsteps) == (0x10, 77, 9)


def test_a_value_that_the_controller_clips(emulator):
    axis = ximc_axis("mm", emulator.address, speed=251.0)
    with pytest.raises(UnsupportedError, match="clipped a value of the command 'smov'"):
        axis.connect()


@pytest.mark.parametrize("build", [ximc_axis, zaber_axis])
def test_the_wrong_device(emulator, build):
    axis = build("mm", emulator.address, serial_number="no such number", answer_timeout_s=0.05)
    with pytest.raises(NotConnectedError, match=r"answers, not no such number|no answer"):
        axis.connect()
    assert not axis.status().connected


def test_the_right_device(emulator):
    (serial,) = emulator.controller.read("gser")
    axis = ximc_axis("mm", emulator.address, serial_number=str(serial), model="8MT175-100", repeatability=0.0015)
    axis.connect()
    info = axis.info()
    assert (info.vendor, info.model, info.serial) == ("Standa XIMC", "8MT175-100", str(serial))
    assert (info.unit, info.resolution, info.repeatability) == ("mm", 1.0 / 400.0 / 256, 0.0015)
    axis.close()
