"""While the pressure comes to rest it is watched as during the ramp: a stop and its limit end it at once, vented."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from bscd.acquisition import RunFile, RunState
from bscd.errors import CheckFailedError
from bscd.procedures import ProcedureStoppedError
from bscd.procedures.recording import InflationRecipe, record_inflation
from tests.procedures.test_recording import twin, vented
from tests.procedures.test_streaming import Sampled

__all__ = ["twin"]

SLOW = InflationRecipe(rest_frames=2, ramp_s=0.2, hold_s=0.2, top_kpa=4.0, exposure_s=0.02, rest_settle_s=600.0)


class Reading:
    """A source that reads what it is told, and calls somebody with each reading."""

    def __init__(self, source, kpa, called=lambda: None):
        self._source, self._kpa, self._called = source, kpa, called

    def read(self):
        self._called()
        reading = self._source.read()
        return reading if self._kpa is None else replace(reading, pressure_kpa=self._kpa)

    def __getattr__(self, name):
        return getattr(self._source, name)


@pytest.mark.parametrize("settle_s", [0.0, 600.0])
def test_a_stop_ends_it_within_a_slice(twin, tmp_path, settle_s):
    stop, asked_s = threading.Event(), []

    def ask():
        if twin.clock.now_s() >= 0.5 and not stop.is_set():
            asked_s.append(twin.clock.now_s())
            stop.set()

    vent = twin.rig.pressure.vent
    twin.rig.pressure.vent = lambda: (asked_s.append(twin.clock.now_s()), vent())
    recipe = SLOW.model_copy(update={"rest_settle_s": settle_s})
    rig = replace(twin.rig, pressure=Reading(twin.rig.pressure, 2.0, ask))  # never at rest
    with pytest.raises(ProcedureStoppedError, match="before the first frame: stopped as asked"):
        record_inflation(rig, recipe, tmp_path / "i.h5", stop=stop)
    assert asked_s[1] - asked_s[0] <= 0.1 + 1e-9
    assert vented(twin)
    with RunFile(tmp_path / "i.h5") as run:
        assert run.state is RunState.INTERRUPTED
        assert run.reason == "inflation: before the first frame: stopped as asked"
        assert (len(run.table()), run.frames_acquired) == (0, 0)


def test_a_pressure_above_its_limit_ends_it(twin, tmp_path):
    begun_s = twin.clock.now_s()
    rig = replace(twin.rig, pressure=Reading(twin.rig.pressure, 15.0))
    with pytest.raises(CheckFailedError, match=r"reached 15.00 kPa, above its limit of 4.5 kPa; look at the regulator"):
        record_inflation(rig, SLOW, tmp_path / "i.h5")
    assert twin.clock.now_s() - begun_s < 0.5
    assert vented(twin)
    with RunFile(tmp_path / "i.h5") as run:
        assert run.state is RunState.INTERRUPTED
        assert "above its limit of 4.5 kPa" in run.reason
        assert (run.pressure_log()[1] == 15.0).all()
        assert len(run.pressure_log()[1]) == 2


def test_what_was_read_on_the_way_is_in_the_log(twin, tmp_path):
    done = record_inflation(twin.rig, SLOW.model_copy(update={"rest_settle_s": 5.0}), tmp_path / "i.h5")
    with RunFile(done.path) as run:
        times_s = run.pressure_log()[0] * 1e-9
        before = times_s[times_s < run.table()["host_time_ns"][0] * 1e-9]
        assert before[-1] - before[0] > 5.0
        assert np.diff(times_s).max() < 0.11


def test_a_pressure_that_is_still_falling_is_no_burst(twin, tmp_path):
    twin.rig.pressure.set_pressure(2.0)
    twin.clock.sleep(5.0)
    assert twin.rig.pressure.true_pressure_kpa() > 1.9
    recipe = SLOW.model_copy(update={"rest_settle_s": 0.0})
    assert record_inflation(twin.rig, recipe, tmp_path / "i.h5").frames == recipe.frame_count


def test_a_source_that_samples_by_itself_comes_to_rest(twin, tmp_path):
    rig = replace(twin.rig, pressure=Sampled(twin.rig.pressure))
    recipe = SLOW.model_copy(update={"rest_settle_s": 1.0})
    assert record_inflation(rig, recipe, tmp_path / "i.h5").frames == recipe.frame_count
