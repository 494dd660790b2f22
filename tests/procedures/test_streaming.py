"""An inflation as a stream, on the twin in virtual time: its endings, its camera, its disk and who follows it."""

from dataclasses import replace
from types import SimpleNamespace

import h5py
import nexusformat.nexus as nx
import numpy as np
import pytest

from bscd.acquisition import RunFile, RunState
from bscd.acquisition.stream import Keep
from bscd.errors import BscdError
from bscd.procedures.recording import Ending, InflationRecipe, Storing, record_inflation
from drivers.errors import NotConnectedError
from drivers.interfaces import PressureReading, PressureReadings
from drivers.simulated.faults import Fault
from tests.procedures.test_recording import Failing, twin, vented

__all__ = ["twin"]

QUICK = InflationRecipe(rest_frames=4, ramp_s=1.0, hold_s=1.0, top_kpa=8.0, exposure_s=0.02)


class Bursting:
    """A source whose membrane holds up to a pressure, and then no more."""

    def __init__(self, source, at_kpa, after_kpa):
        self._source, self._at_kpa, self._after_kpa, self._burst = source, at_kpa, after_kpa, False

    def read(self):
        reading = self._source.read()
        self._burst = self._burst or reading.pressure_kpa > self._at_kpa
        return replace(reading, pressure_kpa=self._after_kpa) if self._burst else reading

    def __getattr__(self, name):
        return getattr(self._source, name)


class Vanishing:
    """A camera that goes away with a frame, and is there again after a while."""

    def __init__(self, camera, clock, at_frame, away_s):
        self._camera, self._clock, self._at, self._away_s = camera, clock, at_frame, away_s
        self._back_s = None

    def read(self, timeout_s=5.0):
        self._at -= 1
        if self._at == 0:
            self._camera.close()
            self._back_s = self._clock.now_s() + self._away_s
        return self._camera.read(timeout_s)

    def connect(self):
        if self._back_s is not None and self._clock.now_s() < self._back_s:
            raise NotConnectedError("primary", "connecting: it is not there", "check its cable")
        self._camera.connect()

    def __getattr__(self, name):
        return getattr(self._camera, name)


class Sampled:
    """A source that samples by itself, 50 times a second of its own readings."""

    sample_rate_hz = 50.0

    def __init__(self, source):
        self._source = source

    def readings_since(self, host_time_ns):
        now_ns = self._source.read().host_time_ns
        times = range(host_time_ns + 20_000_000, now_ns + 1, 20_000_000)
        kpa = self._source.true_pressure_kpa()
        return PressureReadings(tuple(PressureReading(kpa, at) for at in times), 0)

    def __getattr__(self, name):
        return getattr(self._source, name)


class Follower:
    name = "follower"

    def __init__(self, depth=2, fails=""):
        self.depth, self.fails, self.numbers = depth, fails, []

    def begin(self, ring):
        if self.fails == "begin":
            raise BscdError("follower: it has no calibration")
        self.subscription = ring.subscribe(self.name, Keep.FIRST, self.depth)

    def end(self):
        while (lease := self.subscription.take(0.0)) is not None:
            with lease:
                self.numbers.append(lease.number)
        if self.fails == "end":
            raise RuntimeError("its worker died")


class TestEndings:
    def test_a_burst_ends_it_complete_and_vented(self, twin, tmp_path):
        rig = replace(twin.rig, pressure=Bursting(twin.rig.pressure, 5.0, 1.0))
        done = record_inflation(rig, QUICK, tmp_path / "i.h5")
        assert done.ending is Ending.BURST
        assert 4 < done.frames < QUICK.frame_count
        assert done.lost_frames == 0
        assert vented(twin)
        with RunFile(done.path) as run:
            assert run.complete
            assert run.frames_acquired == done.frames == len(run.table())
            (event,) = run.events
            assert "the membrane burst or leaks" in event.text == done.reason

    def test_one_low_reading_is_no_burst(self, twin, tmp_path):
        class Spiking(Bursting):
            def read(self):
                reading = super().read()
                self._at_kpa = 1e9 if self._burst else self._at_kpa
                self._burst = False
                return reading

        rig = replace(twin.rig, pressure=Spiking(twin.rig.pressure, 5.0, 1.0))
        assert record_inflation(rig, QUICK, tmp_path / "i.h5").ending is Ending.COMPLETED

    def test_a_pressure_above_its_limit_ends_it(self, twin, tmp_path):
        rig = replace(twin.rig, pressure=Bursting(twin.rig.pressure, 6.0, 9.5))
        done = record_inflation(rig, QUICK, tmp_path / "i.h5")
        assert done.ending is Ending.LIMIT
        assert "9.50 kPa, above its limit of 8.8 kPa" in done.reason
        assert vented(twin)

    def test_a_limit_below_the_top_is_refused(self):
        with pytest.raises(ValueError, match="limit_kpa = 5 must not be below top_kpa = 8"):
            InflationRecipe(top_kpa=8.0, limit_kpa=5.0)

    def test_steps_go_up_to_the_top(self):
        recipe = InflationRecipe(rest_kpa=0.0, top_kpa=8.0, ramp_s=4.0, steps=4)
        assert [recipe.set_point_kpa(s) for s in (0.0, 0.99, 1.01, 2.5, 3.5, 4.0, 9.0)] == [2, 2, 4, 6, 8, 8, 8]


class TestCamera:
    def test_one_that_went_away_and_came_back_leaves_a_counted_gap(self, twin, tmp_path):
        camera = Vanishing(twin.rig.primary, twin.clock, at_frame=10, away_s=0.8)
        done = record_inflation(replace(twin.rig, primary=camera), QUICK, tmp_path / "i.h5")
        assert done.ending is Ending.COMPLETED
        assert 9 <= done.lost_frames <= 20
        assert done.frames + done.lost_frames == QUICK.frame_count
        assert vented(twin)
        with RunFile(done.path) as run:
            (loss,) = run.losses
            assert (loss.first, loss.count) == (9, done.lost_frames)
            assert "the camera was away" in loss.reason
            table = run.table()
            gap_s = np.diff(table["host_time_ns"]).max() * 1e-9
            assert abs(gap_s * 11.0 - (done.lost_frames + 1)) < 0.5 + 1e-6
            assert run.verify() is None

    def test_one_that_stays_away_ends_it_vented(self, twin, tmp_path):
        camera = Vanishing(twin.rig.primary, twin.clock, at_frame=10, away_s=1000.0)
        with pytest.raises(NotConnectedError):
            record_inflation(replace(twin.rig, primary=camera), QUICK, tmp_path / "i.h5")
        assert vented(twin)
        with RunFile(tmp_path / "i.h5") as run:
            assert run.state is RunState.INTERRUPTED
            assert (len(run.table()), run.frames_acquired) == (9, 9)

    def test_the_ramp_waits_for_a_camera_that_is_away(self, twin, tmp_path):
        """Or the membrane would get at once what it should get in that time."""
        set_points = []
        set_pressure = twin.rig.pressure.set_pressure
        twin.rig.pressure.set_pressure = lambda kpa: (set_points.append(kpa), set_pressure(kpa))
        camera = Vanishing(twin.rig.primary, twin.clock, at_frame=8, away_s=0.8)
        record_inflation(replace(twin.rig, primary=camera), QUICK, tmp_path / "i.h5")
        assert max(np.diff(set_points)) < 4.5 / 11.0 * 8.0

    def test_software_pacing_asks_for_each_frame(self, twin, tmp_path):
        recipe = QUICK.model_copy(update={"pacing": "software"})
        done = record_inflation(twin.rig, recipe, tmp_path / "i.h5")
        assert (done.frames, done.lost_frames) == (QUICK.frame_count, 0)
        with RunFile(done.path) as run:
            assert np.allclose(run.table()["time_s"], np.arange(26) / 11.0, atol=1e-6)

    def test_software_pacing_counts_what_it_missed(self, twin, tmp_path):
        recipe = QUICK.model_copy(update={"pacing": "software"})

        def lose(progress):
            if progress.done == 6:
                twin.rig.primary.faults.inject(Fault.DROPPED_FRAME, count=1)

        done = record_inflation(twin.rig, recipe, tmp_path / "i.h5", progress=lose)
        assert done.lost_frames >= 1
        assert done.frames + done.lost_frames == recipe.frame_count


class TestDisk:
    def test_one_that_fills_ends_it_vented_with_what_it_has(self, twin, tmp_path, monkeypatch):
        def fill(progress):
            if progress.done == 10:
                monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=60_000_000))

        with pytest.raises(BscdError, match="the disk is full"):
            record_inflation(twin.rig, QUICK, tmp_path / "i.h5", progress=fill)
        monkeypatch.undo()
        assert vented(twin)
        assert not twin.rig.primary.status().streaming
        with RunFile(tmp_path / "i.h5") as run:
            assert run.state is RunState.INTERRUPTED
            assert "the disk is full" in run.reason
            assert len(run.table()) == 10
            assert run.frames_acquired == 10 + sum(loss.count for loss in run.losses)
            assert run.verify() is None

    def test_compressed_it_is_the_same(self, twin, tmp_path):
        done = record_inflation(twin.rig, QUICK, tmp_path / "i.h5", storing=Storing(compression="bitshuffle-lz4"))
        with RunFile(done.path) as run:
            assert run.verify() is None
            assert run.path.stat().st_size < 26 * 640 * 512

    def test_it_opens_with_its_images_as_the_default_plot(self, twin, tmp_path):
        record_inflation(twin.rig, QUICK, tmp_path / "i.h5")
        plot = nx.nxload(tmp_path / "i.h5").plottable_data
        assert plot.nxsignal.shape == (26, 512, 640)
        assert [len(axis) for axis in plot.nxaxes] == [26, 512, 640]
        with h5py.File(tmp_path / "i.h5") as file:
            assert file.attrs["default"] == "entry"
            assert file["entry"].attrs["default"] == "data"
            assert file["entry/data"].attrs["signal"] == "data"
            assert list(file["entry/data"].attrs["axes"]) == ["sequence_number", ".", "."]


class TestFollowers:
    def test_they_get_the_frames_in_order_as_far_as_they_have_room(self, twin, tmp_path):
        follower = Follower(depth=30)
        record_inflation(twin.rig, QUICK, tmp_path / "i.h5", followers=[follower])
        assert follower.numbers == list(range(26))
        slow = Follower(depth=2)
        record_inflation(twin.rig, QUICK, tmp_path / "j.h5", followers=[slow])
        assert slow.numbers == [0, 1]
        assert slow.subscription.left_out == tuple(range(2, 26))

    def test_one_that_can_not_begin_refuses_the_recording(self, twin, tmp_path):
        with pytest.raises(BscdError, match="no calibration"):
            record_inflation(twin.rig, QUICK, tmp_path / "i.h5", followers=[Follower(), Follower(fails="begin")])
        assert twin.rig.pressure.set_point_kpa() == 0.0

    def test_one_that_ends_badly_costs_no_frame(self, twin, tmp_path):
        done = record_inflation(twin.rig, QUICK, tmp_path / "i.h5", followers=[Follower(fails="end")])
        with RunFile(done.path) as run:
            assert run.complete
            assert len(run.table()) == 26
            assert [event.text for event in run.events] == ["follower ended badly: its worker died"]

    def test_a_source_that_samples_by_itself_is_logged_whole(self, twin, tmp_path):
        rig = replace(twin.rig, pressure=Sampled(twin.rig.pressure))
        done = record_inflation(rig, QUICK, tmp_path / "i.h5")
        with RunFile(done.path) as run:
            times, kpa = run.pressure_log()
            assert len(times) > 2 * done.frames
            assert (np.diff(times) == 20_000_000).all()
            assert kpa.max() > 7.0


def test_a_silent_camera_is_given_time_and_then_ends_it(twin, tmp_path):
    begun_s = []
    camera = Failing(twin.rig.primary, 5)
    with pytest.raises(Exception, match="none came"):
        record_inflation(
            replace(twin.rig, primary=camera),
            QUICK,
            tmp_path / "i.h5",
            progress=lambda _: begun_s.append(twin.clock.now_s()),
        )
    assert 5.0 < twin.clock.now_s() - begun_s[-1] < 6.0
