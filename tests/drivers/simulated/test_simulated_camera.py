"""The simulated camera: the contract, and what only a simulation can tell (exposure times, losses, noise)."""

import numpy as np
import pytest

from drivers.clock import HostClock
from drivers.errors import DeviceFaultError, DeviceTimeoutError, OutOfLimitsError
from drivers.registry import DriverContext
from drivers.simulated import Fault, SimulatedAxis, SimulatedCamera, SimulatedCameraOptions, TranslationOptions
from tests.drivers.contract.camera_contract import CameraContract
from tests.drivers.simulated.tiny_world import TinyWorld


@pytest.fixture
def camera(clock, world):
    camera = SimulatedCamera(SimulatedCameraOptions(), DriverContext("primary", clock, world))
    camera.connect()
    yield camera
    camera.close()


class TestSimulatedCamera(CameraContract):
    @pytest.fixture
    def camera(self, clock, world):
        return SimulatedCamera(SimulatedCameraOptions(), DriverContext("primary", clock, world))


class TestAuxiliaryCamera(CameraContract):
    @pytest.fixture
    def camera(self, clock, world):
        return SimulatedCamera(SimulatedCameraOptions(camera="auxiliary"), DriverContext("auxiliary", clock, world))


def test_a_snap_takes_exposure_and_readout_and_shows_its_middle(clock, world, camera):
    camera.configure(exposure_s=0.05)
    clock.sleep(3.0)
    frame = camera.snap()
    assert world.exposures_s == pytest.approx([3.025], abs=1e-12)
    assert frame.camera_time_ns == 3_025_000_000
    assert frame.host_time_ns == 3_060_000_000
    assert clock.now_s() == pytest.approx(3.06, abs=1e-12)


def test_a_stream_is_exposed_at_its_own_times(clock, world, camera):
    camera.configure(exposure_s=0.02, frame_rate_hz=10.0)
    clock.sleep(1.0)
    camera.start()
    frames = [camera.read() for _ in range(5)]
    assert world.exposures_s == pytest.approx([1.01, 1.11, 1.21, 1.31, 1.41], abs=1e-9)
    assert [frame.camera_time_ns for frame in frames] == pytest.approx([1.01e9, 1.11e9, 1.21e9, 1.31e9, 1.41e9])
    assert frames[-1].host_time_ns == pytest.approx(1.43e9)
    assert clock.now_s() == pytest.approx(1.43, abs=1e-9)


def test_a_stream_sees_a_move_that_is_under_way(clock, world, camera):
    stage = SimulatedAxis(
        TranslationOptions(repeatability_mm=0.0, homed_at_start=True, start_mm=0.0),
        DriverContext("translation", clock, world),
    )
    stage.connect()
    camera.configure(frame_rate_hz=1.0)
    camera.start()
    stage.move_to(60.0)
    seen = [int(camera.read().data[0, 1]) for _ in range(13)]
    # the k-th exposure is at k + 0.01 s; 5 mm/s, 0.625 mm behind after the first ramp, 60 mm reached after 12.25 s
    assert seen == [0, 4, 9, 14, 19, 24, 29, 34, 39, 44, 49, 54, 59]
    assert camera.status().lost_frames == 0


def test_frames_for_which_there_is_no_room_are_lost_and_counted(clock, world):
    camera = SimulatedCamera(SimulatedCameraOptions(buffer_frames=4), DriverContext("primary", clock, world))
    camera.connect()
    camera.configure(exposure_s=0.02, frame_rate_hz=10.0)
    camera.start()
    first = camera.read().frame_id
    clock.sleep(1.0)
    ids = [camera.read().frame_id - first for _ in range(6)]
    # ten more were exposed by now, four kept, six lost; then it goes on
    assert ids == [1, 2, 3, 4, 11, 12]
    status = camera.status()
    assert (status.delivered_frames, status.lost_frames) == (7, 6)
    assert len(world.exposures_s) == 7
    camera.close()


def test_dropped_frames_are_jumps_of_the_frame_id(camera):
    camera.start()
    first = camera.read().frame_id
    camera.faults.inject(Fault.DROPPED_FRAME, count=3)
    ids = [camera.read().frame_id - first for _ in range(3)]
    assert ids == [4, 5, 6]
    assert camera.status().lost_frames == 3
    assert camera.faults.active() == frozenset()


def test_settings_hold_from_the_next_exposure_on(world, camera):
    camera.configure(exposure_s=0.02, frame_rate_hz=10.0)
    camera.start()
    before = camera.read()
    camera.configure(exposure_s=0.04, frame_rate_hz=5.0)
    later = [camera.read() for _ in range(3)][1:]
    assert before.data[1:].mean() == pytest.approx(100.0, abs=1.0)
    assert [frame.data[1:].mean() for frame in later] == pytest.approx([200.0, 200.0], abs=1.0)
    assert np.diff(world.exposures_s)[-1] == pytest.approx(0.2, abs=1e-9)


def test_exposure_and_gain_scale_the_image(camera):
    dark = camera.snap().data[1:].mean()
    camera.configure(exposure_s=0.01, gain_db=20.0 * np.log10(2.0))
    assert camera.snap().data[1:].mean() == pytest.approx(dark, abs=0.5)
    camera.configure(exposure_s=0.04, gain_db=0.0)
    assert camera.snap().data[1:].mean() == pytest.approx(2.0 * dark, abs=0.5)


def test_an_exposure_must_fit_the_frame_rate(camera):
    with pytest.raises(OutOfLimitsError, match="does not fit 11 Hz"):
        camera.configure(exposure_s=0.1)
    camera.configure(exposure_s=0.1, frame_rate_hz=10.0)
    with pytest.raises(OutOfLimitsError, match="choose one from 0 to 24 dB"):
        camera.configure(gain_db=24.1)


def test_noise_is_seeded_and_each_camera_has_its_own(clock):
    def image(name: str, seed: int) -> np.ndarray:
        camera = SimulatedCamera(
            SimulatedCameraOptions(seed=seed), DriverContext(name, clock, TinyWorld(clock, shape=(64, 64)))
        )
        camera.connect()
        return camera.snap().data.astype(float)

    first = image("primary", 1)
    assert np.array_equal(first, image("primary", 1))
    for other in (image("primary", 2), image("auxiliary", 1)):
        correlation = np.corrcoef(first.ravel(), other.ravel())[0, 1]
        assert abs(correlation) < 0.08
        assert np.std(first - other) == pytest.approx(2.0 * np.sqrt(2.0), rel=0.1)


def test_two_snaps_differ_by_noise(camera):
    assert not np.array_equal(camera.snap().data, camera.snap().data)


def test_a_world_that_fails_ends_the_stream_with_an_error(world, camera, monkeypatch):
    camera.start()
    camera.read()

    def fail(*_args, **_kwargs):
        raise RuntimeError("no light")

    monkeypatch.setattr(world, "expose", fail)
    with pytest.raises(DeviceFaultError, match="no light") as raised:
        camera.read()
    assert isinstance(raised.value.__cause__, RuntimeError)
    camera.stop()
    with pytest.raises(DeviceFaultError, match="no light"):
        camera.snap()
    monkeypatch.undo()
    camera.start()
    assert camera.read().data.shape == world.shape


def test_stopping_discards_what_was_not_read(clock, camera):
    camera.start()
    last = camera.read().frame_id
    clock.sleep(0.5)
    camera.stop()
    with pytest.raises(DeviceTimeoutError):
        camera.read()
    camera.start()
    assert camera.read().frame_id > last + 1


def test_streams_on_the_hosts_clock_too():
    clock = HostClock()
    camera = SimulatedCamera(
        SimulatedCameraOptions(exposure_s=0.002, frame_rate_hz=60.0, readout_s=0.0),
        DriverContext("primary", clock, TinyWorld(clock)),
    )
    camera.connect()
    camera.start()
    frames = [camera.read() for _ in range(4)]
    lost = camera.status().lost_frames
    camera.close()
    assert frames[-1].frame_id - frames[0].frame_id == 3 + lost
    assert np.all(np.diff([frame.host_time_ns for frame in frames]) > 0)
