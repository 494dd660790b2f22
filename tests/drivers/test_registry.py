"""The registry: what it finds, what it says of what it can not have, and building the simulated devices."""

import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest
from pydantic import BaseModel, ValidationError

from drivers import registry
from drivers.clock import VirtualClock
from drivers.interfaces import Axis, Camera, PressureSource
from drivers.registry import DriverContext, DriverEntry, Registry, UnknownDriverError, installed_drivers
from drivers.simulated.entries import AXIS, CAMERA, PRESSURE
from tests.drivers.simulated.tiny_world import TinyWorld

ENTRIES = {"camera.simulated": CAMERA, "axis.simulated": AXIS, "pressure.simulated": PRESSURE}


@pytest.fixture
def context():
    clock = VirtualClock()
    return DriverContext("device", clock, TinyWorld(clock))


def install(monkeypatch, **values: str) -> Registry:
    points = [
        EntryPoint(name.replace("__", "."), value, registry.ENTRY_POINT_GROUP)
        for name, several in values.items()
        for value in several.split()
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: points if group == "bscd.drivers" else [])
    return installed_drivers()


def test_finds_what_packages_offer(monkeypatch):
    drivers = install(monkeypatch, camera__simulated="drivers.simulated.entries:CAMERA")
    assert dict(drivers) == {"camera.simulated": CAMERA}
    assert len(drivers) == 1
    assert "axis.simulated" not in drivers


def test_only_what_a_configuration_names_is_imported():
    program = (
        "import sys\n"
        "from drivers.registry import installed_drivers\n"
        "installed_drivers()['camera.simulated']\n"
        "print(*(name for name in sys.modules if name.startswith('drivers.')))"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    imported = told.stdout.split()
    assert "drivers.simulated.entries" in imported
    assert not [name for name in imported if name.startswith(("drivers.cameras", "drivers.stages", "drivers.jacks"))]


def test_names_the_known_drivers():
    with pytest.raises(UnknownDriverError) as raised:
        Registry(ENTRIES)["camera.simulatd"]
    assert str(raised.value) == (
        "no driver 'camera.simulatd'; known: axis.simulated, camera.simulated, pressure.simulated"
    )
    assert isinstance(raised.value, KeyError)
    assert Registry(ENTRIES).get("camera.simulatd") is None


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("no_such_module_at_all:ENTRY", "No module named 'no_such_module_at_all'"),
        ("drivers.simulated.entries:NOTHING", "has no attribute 'NOTHING'"),
        ("drivers.simulated:Fault", "is no DriverEntry"),
        ("drivers.simulated.entries:CAMERA drivers.simulated.entries:AXIS", "two packages"),
    ],
)
def test_a_broken_driver_leaves_the_others_alone(monkeypatch, value, reason):
    drivers = install(monkeypatch, pressure__simulated="drivers.simulated.entries:PRESSURE", camera__other=value)
    assert dict(drivers) == {"pressure.simulated": PRESSURE}
    assert reason in drivers.broken["camera.other"]
    with pytest.raises(UnknownDriverError, match=reason):
        drivers["camera.other"]


def test_a_package_found_twice_counts_once(monkeypatch):
    value = "drivers.simulated.entries:CAMERA"
    drivers = install(monkeypatch, camera__simulated=f"{value} {value}")
    assert dict(drivers) == {"camera.simulated": CAMERA}
    assert drivers.broken == {}


@pytest.mark.parametrize(
    ("name", "options", "protocol"),
    [
        ("camera.simulated", {"camera": "auxiliary", "frame_rate_hz": 5}, Camera),
        ("axis.simulated", {"quantity": "rotation"}, Axis),
        ("axis.simulated", {"quantity": "translation", "limits_mm": [0, 60]}, Axis),
        ("axis.simulated", {"quantity": "jack", "lower_share": 1.0}, Axis),
        ("pressure.simulated", {}, PressureSource),
    ],
)
def test_builds_the_simulated_devices(context, name, options, protocol):
    entry = Registry(ENTRIES)[name]
    device = entry.build(options, context)
    assert isinstance(device, protocol)
    assert device.name == "device"
    assert entry.kind == name.partition(".")[0]
    assert entry.summary
    device.connect()
    device.close()


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("camera.simulated", {"exposure_ms": 20}, "exposure_ms"),
        ("camera.simulated", {"exposure_s": 2.0}, "exposure_s = 2 must lie in the limits"),
        ("camera.simulated", {"exposure_s": 0.2}, "does not fit 11 Hz"),
        ("camera.simulated", {"gain_limits_db": [24, 0]}, "must be low, then high"),
        ("camera.simulated", {"camera": "third"}, "'primary' or 'auxiliary'"),
        ("axis.simulated", {}, "quantity"),
        ("axis.simulated", {"quantity": "tilt"}, "'rotation', 'translation', 'jack'"),
        ("axis.simulated", {"quantity": "rotation", "limits_mm": [0, 1]}, "limits_mm"),
        ("axis.simulated", {"quantity": "jack", "start_mm": 85}, "start_mm = 85 must lie in the limits 0 to 84"),
        ("axis.simulated", {"quantity": "translation", "speed_mm_s": 0}, "greater than 0"),
        ("axis.simulated", {"quantity": "translation", "start_mm": float("nan")}, "finite number"),
        ("pressure.simulated", {"lag_s": -1}, "greater than 0"),
    ],
)
def test_refuses_wrong_options(context, name, options, words):
    with pytest.raises(ValidationError) as raised:
        ENTRIES[name].build(options, context)
    assert words in str(raised.value)


@pytest.mark.parametrize("name", ENTRIES)
def test_every_option_is_described_and_frozen(name):
    schema = ENTRIES[name].options.model_json_schema()
    models = list(schema.get("$defs", {}).values()) or [schema]
    for model in models:
        assert model["additionalProperties"] is False
        for key, option in model["properties"].items():
            assert option.get("description"), f"{name}: {key} has no description"
    assert issubclass(ENTRIES[name].options, BaseModel)


def test_options_do_not_change(context):
    options = CAMERA.options.model_validate({})
    with pytest.raises(ValidationError, match="frozen"):
        options.__setattr__("exposure_s", 1.0)


def test_an_entry_needs_no_summary():
    assert DriverEntry("camera", CAMERA.options, CAMERA.factory).summary == ""
