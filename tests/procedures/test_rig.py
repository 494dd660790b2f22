import threading
from dataclasses import replace

import pytest

from bscd.procedures import ProcedureStoppedError, RigNotReadyError, home
from drivers.errors import DeviceError, DeviceFaultError
from drivers.simulated.faults import Fault
from tests.procedures.twin_rig import TwinRig


def inject(device, fault: Fault) -> None:
    device.faults.inject(fault)


class TestConnect:
    def test_all_failures_are_reported_together(self, twin: TwinRig) -> None:
        twin.rig.close()
        for device in (twin.rig.primary, twin.rig.translation, twin.rig.jacks):
            inject(device, Fault.NO_ANSWER)
        with pytest.raises(RigNotReadyError, match="3 of 5 devices failed") as failed:
            twin.rig.connect()
        assert set(failed.value.failures) == {"primary", "translation", "jacks"}
        assert all(name in str(failed.value) for name in failed.value.failures)
        assert "\n" not in str(failed.value)
        assert twin.rig.rotation.status().connected

    def test_can_be_called_again(self, twin: TwinRig) -> None:
        twin.rig.close()
        inject(twin.rig.rotation, Fault.NO_ANSWER)
        with pytest.raises(RigNotReadyError):
            twin.rig.connect()
        twin.rig.rotation.faults.clear()  # type: ignore[attr-defined]  # the simulated axis's
        twin.rig.connect()
        assert all(device.status().connected for device in (*twin.rig.cameras.values(), *twin.rig.axes.values()))

    def test_a_rig_without_an_auxiliary_camera(self, twin: TwinRig) -> None:
        rig = replace(twin.rig, auxiliary=None)
        assert list(rig.cameras) == ["primary"]
        assert "auxiliary" not in rig.devices


class TestHome:
    def test_homes_what_does_not_know_where_it_is(self) -> None:
        twin = TwinRig(homed=False)
        said: list[str] = []
        done = home(twin.rig, progress=said.append)
        assert all(axis.status().homed for axis in twin.rig.axes.values())
        assert [homed.moved for homed in done.values()] == [True] * 3
        # the reference switches of the simulated axes
        assert {role: homed.position for role, homed in done.items()} == {
            "jacks": 0.0,
            "translation": 0.0,
            "rotation": 0.0,
        }
        assert said == ["homing the jacks", "homing the translation", "homing the rotation"]

    def test_moves_nothing_that_is_homed(self, twin: TwinRig) -> None:
        before = twin.positions()
        done = home(twin.rig)
        assert twin.positions() == before
        assert not any(homed.moved for homed in done.values())
        assert home(twin.rig, again=True)["rotation"].moved

    def test_a_fault_is_told_and_nothing_moves_afterwards(self) -> None:
        twin = TwinRig(homed=False)
        inject(twin.rig.translation, Fault.STALLED_MOVE)
        with pytest.raises(DeviceFaultError, match="translation"):
            home(twin.rig)
        assert not twin.moving()
        assert not twin.rig.rotation.status().homed

    def test_stops_between_axes(self) -> None:
        twin = TwinRig(homed=False)
        stop = threading.Event()
        with pytest.raises(ProcedureStoppedError, match="before the translation"):
            home(twin.rig, progress=lambda _: stop.set(), stop=stop)
        assert twin.rig.jacks.status().homed
        assert not twin.rig.translation.status().homed


def test_stop_axes_reaches_every_axis_though_one_does_not_answer(twin: TwinRig) -> None:
    stopped: list[str] = []

    class Silent:
        def stop(self) -> None:
            raise DeviceError("jacks", "stopping: no answer")

    class Counting:
        def stop(self) -> None:
            stopped.append("axis")

    rig = replace(twin.rig, jacks=Silent(), translation=Counting(), rotation=Counting())  # type: ignore[arg-type]
    rig.stop_axes()
    assert stopped == ["axis", "axis"]
