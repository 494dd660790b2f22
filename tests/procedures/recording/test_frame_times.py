"""Frames keep their times and pressures when the camera's clock begins anew, against the twin's own."""

from dataclasses import replace

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.procedures.recording import InflationRecipe, record_inflation
from tests.procedures.test_recording import twin
from tests.procedures.test_streaming import Vanishing

__all__ = ["twin"]

RECIPE = InflationRecipe(rest_frames=4, ramp_s=2.0, hold_s=1.0, top_kpa=8.0, exposure_s=0.02)


class PowerCycled(Vanishing):
    """Its clock begins at 0 when it is back."""

    behind_ns = 0

    def connect(self):
        super().connect()
        self.behind_ns = round(self._clock.now_s() * 1e9)

    def read(self, timeout_s=5.0):
        frame = super().read(timeout_s)
        return replace(frame, camera_time_ns=frame.camera_time_ns - self.behind_ns)


class Set:
    """A camera whose clock is set by somebody between two frames; it is there all the while."""

    def __init__(self, camera, at_frame, ahead_s):
        self._camera, self._left, self._ahead_ns = camera, at_frame, round(ahead_s * 1e9)

    def read(self, timeout_s=5.0):
        frame = self._camera.read(timeout_s)
        self._left -= 1
        return frame if self._left >= 0 else replace(frame, camera_time_ns=frame.camera_time_ns + self._ahead_ns)

    def __getattr__(self, name):
        return getattr(self._camera, name)


@pytest.fixture
def exposed(twin):
    """The true time and pressure in the middle of each exposure, by the id of its frame."""
    seen = {}
    take = twin.rig.primary._take

    def witness(arrival_s, wanted):
        now = twin.clock.now_s(), twin.rig.pressure.true_pressure_kpa()
        frame = take(arrival_s, wanted)
        if frame is not None:
            seen[frame.frame_id] = now
        return frame

    twin.rig.primary._take = witness
    return seen


def check(run, exposed, most_s=0.02):
    """Time goes on, and times and pressures are the true ones, within the bound that the run states."""
    table = check_times(run, exposed, most_s)
    kpa = np.array([exposed[frame_id][1] for frame_id in table["frame_id"]])
    steepest_kpa_s = 8.0  # of the set-point while it catches up
    allowed_kpa = 2.0 * run.time_base.uncertainty_s * steepest_kpa_s + 0.02  # the source's noise as well
    assert np.abs(table["pressure_kpa"] - kpa).max() < allowed_kpa
    return table


def check_times(run, exposed, most_s=0.02):
    table = run.table()
    times_s = np.array([exposed[frame_id][0] for frame_id in table["frame_id"]])
    bound_s = run.time_base.uncertainty_s
    assert bound_s < most_s
    assert (np.diff(table["time_s"]) > 0.0).all()
    assert np.abs(table["time_s"] - (times_s - times_s[0])).max() < 2.0 * bound_s
    return table


def test_a_power_cycle(twin, exposed, tmp_path):
    camera = PowerCycled(twin.rig.primary, twin.clock, at_frame=10, away_s=0.8)
    done = record_inflation(replace(twin.rig, primary=camera), RECIPE, tmp_path / "i.h5")
    with RunFile(done.path) as run:
        table = check(run, exposed)
        assert table["camera_time_ns"][9] < table["camera_time_ns"][8]  # as the camera said
        lost, jumped, after = (event.text for event in run.events)
        first_id = table["frame_id"][9]
        assert "the camera was away" in lost or "the camera was away" in jumped
        told = jumped if "jumped" in jumped else lost
        assert f"s before frame id {first_id}; from there on it is laid on the host's anew" in told
        assert float(told.split("jumped by ")[1].split()[0]) == pytest.approx(-camera.behind_ns * 1e-9, abs=0.05)
        # the second part's offset is in the last event: the true one is what the camera's clock is behind
        offset_ns, bound_ms = int(after.split(" is ")[1].split()[0]), float(after.split("at most ")[1].split()[0])
        assert abs(offset_ns - camera.behind_ns) * 1e-6 <= bound_ms + 0.005
        assert bound_ms * 1e-3 <= run.time_base.uncertainty_s + 5e-6
        assert abs(run.time_base.offset_ns) * 1e-9 <= run.time_base.uncertainty_s


def test_a_camera_that_was_away_and_kept_its_clock(twin, exposed, tmp_path):
    camera = Vanishing(twin.rig.primary, twin.clock, at_frame=10, away_s=0.8)
    done = record_inflation(replace(twin.rig, primary=camera), RECIPE, tmp_path / "i.h5")
    with RunFile(done.path) as run:
        check(run, exposed)
        assert any("its clock is laid on the host's anew" in event.text for event in run.events)


@pytest.mark.parametrize(("ahead_s", "readout_s"), [(-4.0, None), (-0.2, 0.01), (6.0, None), (1e9, 0.01)])
def test_a_clock_that_is_set_while_the_camera_is_there(twin, exposed, tmp_path, ahead_s, readout_s):
    recipe = RECIPE.model_copy(update={"readout_s": readout_s})
    done = record_inflation(replace(twin.rig, primary=Set(twin.rig.primary, 10, ahead_s)), recipe, tmp_path / "i.h5")
    assert done.lost_frames == 0
    with RunFile(done.path) as run:
        # a readout that is not known may take two periods: nothing says when the second part was begun
        table = check(run, exposed, most_s=0.2 if readout_s is None else 0.002)
        assert run.events[0].text.startswith(f"the camera's clock jumped by {ahead_s:+.3f} s before frame id 10;")
        assert np.allclose(table["time_s"], np.arange(len(table)) / 11.0, atol=2.0 * run.time_base.uncertainty_s)


class Late:
    """A camera whose first frames come late by so much."""

    def __init__(self, camera, late_s):
        self._camera, self._late_s = camera, list(late_s)

    def read(self, timeout_s=5.0):
        frame = self._camera.read(timeout_s)
        late_ns = round(1e9 * (self._late_s.pop(0) if self._late_s else 0.0))
        return replace(frame, host_time_ns=frame.host_time_ns + late_ns)

    def __getattr__(self, name):
        return getattr(self._camera, name)


def test_first_frames_that_are_late_are_told_and_leave_the_time_base_alone(twin, exposed, tmp_path):
    camera = Late(twin.rig.primary, [0.3, 0.2])
    done = record_inflation(replace(twin.rig, primary=camera), RECIPE, tmp_path / "i.h5")
    with RunFile(done.path) as run:
        check(run, exposed)  # at rest another time has the same pressure
        (event,) = run.events
        assert event.text.startswith("2 frames from id 0 on with the pressure of another time, by 30")
        assert abs(run.time_base.offset_ns) * 1e-9 <= run.time_base.uncertainty_s


def test_a_host_that_was_slow_is_no_jump(twin, exposed, tmp_path):
    """The frames of a second wait in the camera's buffer and come in a row."""
    slept = []

    def sleep(progress):
        if progress.done == 10 and not slept:
            slept.append(True)
            twin.clock.sleep(1.2)

    done = record_inflation(twin.rig, RECIPE, tmp_path / "i.h5", progress=sleep)
    with RunFile(done.path) as run:
        check_times(run, exposed)
        assert run.events == ()
