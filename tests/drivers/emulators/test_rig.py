"""A rig whose stages have two controllers each, of two makers, on one motor: what each says of it is true."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.emulators.rig import EmulatedRig, StageProtocol, smallest_step
from drivers.errors import DeviceBusyError, DeviceFaultError, NotHomedError, UnsupportedError
from drivers.interfaces import Axis
from drivers.registry import DriverContext, installed_drivers
from drivers.simulated import JackOptions, RotationOptions, SimulatedAxis, TranslationOptions
from tests.drivers.simulated.tiny_world import TinyWorld

RESOLUTION = {"rotation": 180.0 / 768000.0, "translation": 0.047625e-3}
"""A microstep of the coarser controller."""


@dataclass
class TwoMakers:
    """Both drivers of each stage, and the stages."""

    devices: dict[str, SimulatedAxis]
    sections: dict[StageProtocol, dict[str, dict[str, Any]]]
    clock: VirtualClock
    rig: EmulatedRig
    drivers: list[Axis] = field(default_factory=list)

    def driver(self, maker: StageProtocol, name: str = "translation") -> Axis:
        """Connected."""
        section = {**self.sections[maker][name], **({"answer_timeout_s": 5.0} if name != "jacks" else {})}
        axis = installed_drivers()[section.pop("driver")].build(section, DriverContext(name, self.clock))
        axis.connect()
        self.drivers.append(axis)
        return axis

    def truth(self, name: str = "translation") -> float:
        return self.devices[name].true_position()


@contextmanager
def serving(**options: dict[str, Any]) -> Iterator[TwoMakers]:
    """A rig in virtual time, on free ports; its options by device."""
    clock = VirtualClock()
    world = TinyWorld(clock)

    def stage(name: str, model: Any, unit: str) -> SimulatedAxis:
        given = {
            f"repeatability_{unit}": 0.0,
            f"resolution_{unit}": smallest_step(name),
            **options.get(name, {}),
        }
        return SimulatedAxis(model(**given), DriverContext(name, clock, world))

    devices = {
        "rotation": stage("rotation", RotationOptions, "deg"),
        "translation": stage("translation", TranslationOptions, "mm"),
        "jacks": SimulatedAxis(
            JackOptions(**{"repeatability_mm": 0.0, **options.get("jacks", {})}), DriverContext("jacks", clock, world)
        ),
    }
    rig = EmulatedRig(devices, first_port=None)
    assert rig.start() == []
    zaber = next(one.address for one in rig.served if one.address.startswith("tcp:") and "Zaber" in one.summary)
    both = {"ximc": rig.configuration()}
    with_zaber = EmulatedRig(devices, "zaber", first_port=None)
    with_zaber.start()
    both["zaber"] = with_zaber.configuration()
    with_zaber.stop()
    for name in ("rotation", "translation"):
        both["zaber"][name]["port"] = zaber
    here = TwoMakers(devices, both, clock, rig)
    try:
        yield here
    finally:
        for axis in here.drivers:
            axis.close()
        rig.stop()


@pytest.fixture
def here() -> Iterator[TwoMakers]:
    with serving() as makers:
        yield makers


@pytest.mark.parametrize("name", ["rotation", "translation"])
def test_both_makers_say_where_the_stage_is(here, name):
    ximc, zaber = here.driver("ximc", name), here.driver("zaber", name)
    ximc.home()
    for target in (7.123456, 3.5, 12.0):
        for axis in (ximc, zaber):
            axis.move_to(target)
            assert here.truth(name) == pytest.approx(target, abs=RESOLUTION[name])
            for told in (ximc.status(), zaber.status()):
                assert told.homed
                assert told.position == pytest.approx(here.truth(name), abs=RESOLUTION[name])


def test_a_stage_that_the_other_has_homed_is_homed_for_zaber_only(here):
    ximc, zaber = here.driver("ximc"), here.driver("zaber")
    assert not ximc.status().homed
    assert not zaber.status().homed
    zaber.home()
    zaber.move_to(7.0)
    assert zaber.status().position == pytest.approx(here.truth(), abs=1e-4)
    assert not ximc.status().homed
    with pytest.raises(NotHomedError):
        ximc.move_to(1.0)
    ximc.home()
    ximc.move_to(2.5)
    assert ximc.status().position == pytest.approx(here.truth(), abs=1e-6)
    assert zaber.status().position == pytest.approx(here.truth(), abs=1e-4)


def test_homed_anew_by_the_other(here):
    """The counter of the XIMC may have had another zero: it is not trusted then."""
    ximc, zaber = here.driver("ximc"), here.driver("zaber")
    ximc.home()
    ximc.move_to(4.0)
    here.devices["translation"].carriages[0].begin_home()
    assert not ximc.status().homed
    assert not zaber.status().homed
    here.clock.sleep(60.0)
    assert zaber.status().homed
    assert not ximc.status().homed
    assert zaber.status().position == here.truth() == 0.0


def test_a_home_that_is_not_at_zero():
    with serving(translation={"limits_mm": (2.0, 80.0), "home_mm": 10.0}) as here:
        for maker in ("zaber", "ximc"):
            axis = here.driver(maker)
            axis.home()
            assert axis.status().position == pytest.approx(10.0, abs=RESOLUTION["translation"])
            assert here.truth() == 10.0
            for target in (2.0, 33.3, 80.0):
                axis.move_to(target)
                assert here.truth() == pytest.approx(target, abs=RESOLUTION["translation"])
                assert axis.status().position == pytest.approx(here.truth(), abs=RESOLUTION["translation"])


@pytest.mark.parametrize("maker", ["ximc", "zaber"])
@pytest.mark.parametrize(("name", "limits"), [("rotation", (-180.0, 180.0)), ("translation", (0.0, 100.0))])
def test_the_ends_of_the_travel(here, maker, name, limits):
    axis = here.driver(maker, name)
    axis.home()
    for target in limits:
        axis.move_to(target)
        assert here.truth(name) == pytest.approx(target, abs=RESOLUTION[name])
        assert axis.status().fault == ""


def test_switched_off_and_on_neither_knows_where_it_is(here):
    ximc, zaber = here.driver("ximc"), here.driver("zaber")
    ximc.home()
    ximc.move_to(4.0)
    here.rig.devices_served["translation"].power_cycle()
    assert not ximc.status().connected
    ximc.connect()
    for axis in (ximc, zaber):
        assert not axis.status().homed
        with pytest.raises(NotHomedError):
            axis.move_to(1.0)
    assert here.truth() == pytest.approx(4.0, abs=1e-6)


def test_one_waits_for_the_other(here):
    ximc, zaber = here.driver("ximc"), here.driver("zaber")
    ximc.home()
    here.devices["translation"].carriages[0].drive_to(50.0, 5.0)
    for axis in (ximc, zaber):
        assert axis.status().moving
        with pytest.raises(DeviceBusyError):
            axis.move_to(1.0)


@pytest.mark.parametrize("maker", ["ximc", "zaber"])
def test_an_order_that_comes_a_moment_after_the_other_s(here, maker, monkeypatch):
    """The motor has set off between the look at it and the order: refused, and the line goes on."""
    axis = here.driver(maker)
    axis.home()

    def busy(*_: float) -> None:
        raise DeviceBusyError("translation", "it is moving", "wait")

    monkeypatch.setattr(here.devices["translation"].carriages[0], "drive_to", busy)
    with pytest.raises((DeviceFaultError, UnsupportedError)):
        axis.move_to(1.0)
    monkeypatch.undo()
    axis.move_to(1.0)
    assert here.truth() == pytest.approx(1.0, abs=1e-4)


def test_jacks_whose_home_is_not_at_zero():
    with serving(jacks={"lower_limits_mm": (5.0, 42.0), "upper_limits_mm": (3.5, 20.0), "start_mm": 30.0}) as here:
        jacks = here.driver("ximc", "jacks")
        jacks.home()
        assert here.truth("jacks") == 8.5
        assert jacks.status().position == 8.5
        for target in (62.0, 8.5, 31.07):
            jacks.move_to(target)
            assert here.truth("jacks") == pytest.approx(target, abs=1e-6)
            assert jacks.status().position == pytest.approx(target, abs=1e-6)


def test_a_line_for_each_address(here):
    told = {one.summary: one.address for one in here.rig.served}
    assert len(told) == len(set(told.values())) == 8
    assert sum(address.startswith("tcp://127.0.0.1:") for address in told.values()) == 4
    for what in ("rotation: Standa", "translation: Standa", "Zaber devices: rotation (1), translation (2)"):
        assert len([summary for summary in told if summary.startswith(what)]) == 2
    assert sum("units 1 and 2" in summary for summary in told) == 2
