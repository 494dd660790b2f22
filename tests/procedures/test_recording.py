"""Recording a sphere and an inflation on the twin, in virtual time: what is kept, what is refused, how it ends."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from bscd.acquisition import RunFile, RunState
from bscd.errors import CheckFailedError, InputError
from bscd.procedures import ProcedureStoppedError
from bscd.procedures.recording import InflationRecipe, NotVentedError, SphereRecipe, record_inflation, record_sphere
from drivers.errors import DeviceTimeoutError
from drivers.registry import DriverContext
from drivers.simulated import SimulatedPressure
from drivers.simulated.faults import Fault
from drivers.simulated.options import SimulatedPressureOptions
from tests.procedures.twin_rig import TwinRig

QUICK = InflationRecipe(rest_frames=4, ramp_s=1.0, hold_s=1.0, top_kpa=8.0, exposure_s=0.02)


@pytest.fixture
def twin() -> TwinRig:
    twin = TwinRig()
    pressure = SimulatedPressure(SimulatedPressureOptions(), DriverContext("pressure", twin.clock, twin.world))
    pressure.connect()
    twin.rig = replace(twin.rig, pressure=pressure)
    twin.world.place("membrane")
    return twin


class Failing:
    """A camera whose stream ends in an error after some frames."""

    def __init__(self, camera, after):
        self._camera, self._left = camera, after

    def read(self, timeout_s=5.0):
        self._left -= 1
        if self._left < 0:
            raise DeviceTimeoutError("primary", "reading a frame: none came", "check its cable")
        return self._camera.read(timeout_s)

    def __getattr__(self, name):
        return getattr(self._camera, name)


def vented(twin: TwinRig) -> bool:
    twin.clock.sleep(2.0)
    return twin.rig.pressure.set_point_kpa() == 0.0 and twin.rig.pressure.true_pressure_kpa() < 0.01


class TestInflation:
    def test_every_exposure_is_there_with_its_time_and_pressure(self, twin, tmp_path):
        seen = []
        expose = twin.world.expose

        def witness(camera, **given):
            seen.append((twin.clock.now_s(), twin.rig.pressure.true_pressure_kpa()))
            return expose(camera, **given)

        twin.world.expose = witness
        done = record_inflation(twin.rig, QUICK, tmp_path / "i.h5", config_text="[membrane]\nradius_mm = 15.0\n")
        assert (done.frames, done.dropped) == (QUICK.frame_count, 0) == (26, 0)
        with RunFile(done.path) as run:
            table = run.table("primary", "inflation")
            assert run.complete
            assert run.verify() is None
            assert run.events == ()
            assert "radius_mm" in run.config_text
            assert InflationRecipe.model_validate_json(run.recipe_text) == QUICK
            assert run.header.pressure.noise_kpa == 0.005
            times_ns, first_ns = run.pressure_log()[0], table["host_time_ns"][0]
            assert (times_ns < first_ns).any()  # to interpolate
            assert (times_ns >= first_ns).sum() == 26
            assert (run.frames_acquired, run.losses) == (26, ())
            assert abs(run.time_base.offset_ns) * 1e-9 <= run.time_base.uncertainty_s < 0.01  # the twin's is the host's
            assert (table["y_mm"] == 0.0).all()
            assert (table["rotation_deg"] == 45.0).all()
        assert np.allclose(table["time_s"], np.arange(26) / 11.0, atol=1e-6)
        assert (table["jack_mm"] == 70.0).all()
        assert (table["exposure_s"] == 0.02).all()
        # of the middle of the exposure, but for the readout: 10 ms where 3 ms are likely, at 8 kPa/s
        truth = np.array([kpa for _, kpa in seen[:26]])
        assert np.abs(table["pressure_kpa"] - truth).max() < 0.1
        assert np.abs(truth[:4] - 0.05).max() < 1e-4
        assert truth.max() > 7.0
        assert (np.diff(truth[4:]) > 0).all()

    def test_it_ends_vented_with_the_stream_stopped(self, twin, tmp_path):
        record_inflation(twin.rig, QUICK, tmp_path / "i.h5")
        assert not twin.rig.primary.status().streaming
        assert not twin.moving()
        assert vented(twin)

    def test_a_lost_frame_is_told(self, twin, tmp_path):
        recipe = QUICK.model_copy(update={"rest_frames": 1})

        def lose(progress):
            if progress.done in (6, 22):
                twin.rig.primary.faults.inject(Fault.DROPPED_FRAME, count=2 if progress.done == 6 else 1)

        done = record_inflation(twin.rig, recipe, tmp_path / "i.h5", progress=lose)
        assert (done.lost_frames, done.frames) == (3, recipe.frame_count - 3)
        with RunFile(done.path) as run:
            table = run.table("primary")
            gaps = np.diff(table["frame_id"])
            assert sorted(gaps[gaps > 1]) == [3]  # the last of all was lost too, and no later one shows it
            assert np.allclose(table["time_s"], (table["frame_id"] - table["frame_id"][0]) / 11.0, atol=1e-6)
            assert [event.text for event in run.events] == [
                f"2 frames lost before frame id {table['frame_id'][6]}: lost between camera and host",
                "1 frame lost at the end: lost between camera and host",
            ]
            assert run.frames_acquired == recipe.frame_count
            assert [(loss.first, loss.count) for loss in run.losses] == [(6, 2), (recipe.frame_count - 1, 1)]

    @pytest.mark.parametrize("after", [0, 9])
    def test_it_vents_when_the_camera_fails(self, twin, tmp_path, after):
        rig = replace(twin.rig, primary=Failing(twin.rig.primary, after))
        with pytest.raises(DeviceTimeoutError):
            record_inflation(rig, QUICK, tmp_path / "i.h5")
        assert vented(twin)
        assert not twin.rig.primary.status().streaming
        with RunFile(tmp_path / "i.h5") as run:
            assert run.state is RunState.INTERRUPTED
            assert "none came" in run.reason
            assert len(run.table()) == after

    def test_it_vents_when_it_is_stopped(self, twin, tmp_path):
        stop = threading.Event()

        def stop_at(progress):
            if progress.done == 5:
                stop.set()

        with pytest.raises(ProcedureStoppedError):
            record_inflation(twin.rig, QUICK, tmp_path / "i.h5", stop=stop, progress=stop_at)
        assert vented(twin)

    def test_a_failed_vent_is_told_with_what_came_before(self, twin, tmp_path):
        rig = replace(twin.rig, primary=Failing(twin.rig.primary, 3))

        def silent(progress):
            if progress.done == 3:
                twin.rig.pressure.faults.inject(Fault.NO_ANSWER)

        with pytest.raises(NotVentedError, match=r"reading the pressure.*open the valve by hand"):
            record_inflation(rig, QUICK, tmp_path / "i.h5", progress=silent)
        assert not twin.rig.primary.status().streaming

    def test_a_pressure_that_does_not_come_to_rest(self, twin, tmp_path):
        recipe = QUICK.model_copy(update={"rest_kpa": 6.0, "rest_settle_s": 0.0, "rest_timeout_s": 0.3})
        with pytest.raises(CheckFailedError, match="look for a leak"):
            record_inflation(twin.rig, recipe, tmp_path / "i.h5")
        assert vented(twin)

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"top_kpa": 20.0}, "top_kpa = 20 kPa is outside the pressure source's 0 to 16 kPa"),
            ({"exposure_s": 0.2}, "does not fit 11 frames a second"),
            ({"exposure_s": 2.0}, "primary camera: exposure_s = 2 is outside"),
        ],
    )
    def test_what_the_rig_can_not_do_is_refused_before_anything_happens(self, twin, tmp_path, change, said):
        with pytest.raises(InputError, match=said):
            record_inflation(twin.rig, QUICK.model_copy(update=change), tmp_path / "i.h5")
        assert not (tmp_path / "i.h5").exists()
        assert twin.rig.pressure.set_point_kpa() == 0.0

    def test_without_a_pressure_source_it_is_refused(self, twin, tmp_path):
        with pytest.raises(InputError, match=r"configure \[devices.pressure\]"):
            record_inflation(replace(twin.rig, pressure=None), QUICK, tmp_path / "i.h5")

    def test_the_ramp_must_rise(self):
        with pytest.raises(ValueError, match="must be above rest_kpa"):
            InflationRecipe(rest_kpa=2.0, top_kpa=1.0)


class TestSphere:
    def test_through_the_biprism_first_then_both_cameras_without_it(self, twin, tmp_path):
        twin.world.place("sphere")
        done = record_sphere(twin.rig, SphereRecipe(frames=2, exposure_s=0.01), tmp_path / "s.h5")
        assert done.frames == 6
        with RunFile(done.path) as run:
            table = run.table()
            assert run.complete
            assert list(zip(table["camera"], table["jack_mm"], strict=True)) == [
                ("primary", 70.0),
                ("primary", 70.0),
                ("primary", 5.0),
                ("auxiliary", 5.0),
                ("primary", 5.0),
                ("auxiliary", 5.0),
            ]
            assert set(table["phase"]) == {"sphere"}
            assert (table["exposure_s"] == 0.01).all()
        assert not twin.moving()

    def test_the_biprism_alone(self, twin, tmp_path):
        twin.world.place("sphere")
        done = record_sphere(twin.rig, SphereRecipe(frames=1, standard_pair=False), tmp_path / "s.h5")
        with RunFile(done.path) as run:
            assert list(run.cameras) == ["primary"]
            assert len(run.table()) == 1

    def test_axes_come_to_rest_when_a_camera_fails(self, twin, tmp_path):
        twin.rig.primary.faults.inject(Fault.NO_ANSWER)
        with pytest.raises(DeviceTimeoutError):
            record_sphere(twin.rig, SphereRecipe(), tmp_path / "s.h5")
        assert not twin.moving()

    def test_without_an_auxiliary_camera_the_standard_pair_is_refused(self, twin, tmp_path):
        with pytest.raises(InputError, match="auxiliary camera is missing"):
            record_sphere(replace(twin.rig, auxiliary=None), SphereRecipe(), tmp_path / "s.h5")
        assert not (tmp_path / "s.h5").exists()
