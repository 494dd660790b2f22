"""What every camera must do. A driver's test class inherits `CameraContract` and overrides the fixtures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest

from drivers.clock import Clock, VirtualClock
from drivers.errors import DeviceBusyError, DeviceTimeoutError, NotConnectedError, OutOfLimitsError
from drivers.interfaces import Camera, FrameStatus
from tests.drivers.contract.outcome import Outcome, all_at_once


class CameraContract:
    """Override `camera`; also `clock` where the driver is not simulated."""

    @pytest.fixture
    def clock(self) -> Clock:
        return VirtualClock()

    @pytest.fixture
    def camera(self, clock: Clock) -> Camera:
        """A driver that is not connected yet."""
        raise NotImplementedError

    @pytest.fixture
    def ready(self, camera: Camera) -> Iterator[Camera]:
        """The camera connected, at 20 ms and 10 Hz."""
        camera.connect()
        camera.configure(exposure_s=0.02, frame_rate_hz=10.0)
        yield camera
        camera.close()

    def test_is_a_camera(self, camera: Camera):
        assert isinstance(camera, Camera)
        assert camera.name

    def test_connects_and_closes_twice(self, camera: Camera):
        camera.close()
        camera.connect()
        camera.connect()
        assert camera.status().connected
        camera.close()
        camera.close()
        assert not camera.status().connected
        camera.connect()
        assert camera.snap().status is FrameStatus.OK
        camera.close()

    def test_connects_and_closes_from_many_threads(self, camera: Camera):
        all_at_once(camera.connect)
        assert camera.status().connected
        all_at_once(camera.close)
        assert not camera.status().connected

    def test_needs_a_connection(self, camera: Camera):
        for call in (camera.info, lambda: camera.configure(gain_db=1.0), camera.snap, camera.start, camera.read):
            with pytest.raises(NotConnectedError, match=camera.name):
                call()
        status = camera.status()
        assert (status.connected, status.streaming) == (False, False)
        camera.stop()

    def test_tells_what_it_can_do(self, ready: Camera):
        info = ready.info()
        assert info.width_px > 0 and info.height_px > 0
        assert 0.001 < info.pixel_size_mm < 0.1
        assert info.bit_depth in range(8, 17)
        assert 0.0 < info.exposure_limits_s.low < info.exposure_limits_s.high
        assert info.gain_limits_db.low < info.gain_limits_db.high
        assert info.vendor and info.model and info.serial

    def test_snaps(self, ready: Camera, clock: Clock):
        info = ready.info()
        before_ns = round(clock.now_s() * 1e9)
        first, second = ready.snap(), ready.snap()
        for frame in (first, second):
            assert frame.data.shape == (info.height_px, info.width_px)
            assert frame.data.dtype == (np.uint8 if info.bit_depth == 8 else np.uint16)
            assert int(frame.data.max()) < 2**info.bit_depth
            assert not frame.data.flags.writeable
            assert frame.status is FrameStatus.OK
        assert second.frame_id == first.frame_id + 1
        assert second.camera_time_ns - first.camera_time_ns >= 0.02e9 - 1
        assert before_ns < first.host_time_ns < second.host_time_ns <= round(clock.now_s() * 1e9)
        status = ready.status()
        assert (status.streaming, status.delivered_frames, status.lost_frames) == (False, 1, 0)

    def test_snap_gives_up_in_time(self, ready: Camera):
        ready.configure(exposure_s=0.1, frame_rate_hz=5.0)
        with pytest.raises(DeviceTimeoutError, match=ready.name):
            ready.snap(timeout_s=0.05)
        assert ready.snap().status is FrameStatus.OK

    def test_snaps_from_many_threads_each_get_a_frame_of_their_own(self, ready: Camera):
        frames = []
        all_at_once(lambda: frames.append(ready.snap()), threads=4)
        assert [frame.status for frame in frames] == [FrameStatus.OK] * 4
        assert len({frame.frame_id for frame in frames}) == 4

    def test_snaps_and_a_start_at_once_wait_for_each_other(self, ready: Camera):
        """Each snap gives a frame or is told of the stream, and the stream gives its frames."""
        turns = itertools.count()

        def command() -> None:
            if next(turns) == 2:
                ready.start()
                return
            with suppress(DeviceBusyError):
                assert ready.snap().status is FrameStatus.OK

        all_at_once(command, threads=4)
        assert ready.status().streaming
        first, second = ready.read(), ready.read()
        assert second.frame_id == first.frame_id + 1
        ready.stop()

    def test_takes_settings(self, ready: Camera):
        gain_db = ready.info().gain_limits_db.high / 2.0
        ready.configure(exposure_s=0.01, gain_db=gain_db, frame_rate_hz=5.0)
        status = ready.status()
        assert status.exposure_s == pytest.approx(0.01, rel=0.01)
        assert status.gain_db == pytest.approx(gain_db, abs=0.1)
        assert status.frame_rate_hz == pytest.approx(5.0, rel=0.01)
        ready.configure(gain_db=0.0)
        assert ready.status().exposure_s == pytest.approx(0.01, rel=0.01)
        ready.configure()
        assert ready.status().gain_db == pytest.approx(0.0, abs=0.1)

    @pytest.mark.parametrize("key", ["exposure_s", "gain_db", "frame_rate_hz"])
    @pytest.mark.parametrize("wrong", [-1e6, 1e6, math.nan])
    def test_refuses_impossible_settings_and_changes_none(self, ready: Camera, key, wrong):
        before = ready.status()
        possible = {"exposure_s": 0.015, "gain_db": 1.0, "frame_rate_hz": 4.0}
        with pytest.raises(OutOfLimitsError, match=ready.name):
            ready.configure(**{**possible, key: wrong})
        assert ready.status() == before

    def test_streams(self, ready: Camera):
        ready.start()
        assert ready.status().streaming
        frames = [ready.read() for _ in range(8)]
        status = ready.status()
        assert (status.streaming, status.delivered_frames, status.lost_frames) == (True, 8, 0)
        assert np.diff([frame.frame_id for frame in frames]).tolist() == [1] * 7
        assert np.all(np.diff([frame.host_time_ns for frame in frames]) > 0)
        camera_s = np.diff([frame.camera_time_ns for frame in frames]) * 1e-9
        assert camera_s == pytest.approx(0.1, abs=0.01)
        ready.stop()
        assert not ready.status().streaming

    def test_streams_again_from_zero(self, ready: Camera):
        for expected in (3, 1):
            ready.start()
            for _ in range(expected):
                ready.read()
            assert ready.status().delivered_frames == expected
            ready.stop()
            ready.stop()

    def test_streaming_excludes_another_start_and_a_snap(self, ready: Camera):
        ready.start()
        with pytest.raises(DeviceBusyError, match=ready.name):
            ready.start()
        with pytest.raises(DeviceBusyError, match=ready.name):
            ready.snap()
        assert ready.read().status is FrameStatus.OK
        ready.stop()
        assert ready.snap().status is FrameStatus.OK

    def test_reading_without_a_stream_gives_up_at_once(self, ready: Camera, clock: Clock):
        before_s = clock.now_s()
        with pytest.raises(DeviceTimeoutError, match="start"):
            ready.read(timeout_s=100.0)
        assert clock.now_s() - before_s < 1.0

    def test_read_gives_up_in_time(self, ready: Camera):
        ready.configure(exposure_s=0.02, frame_rate_hz=1.0)
        ready.start()
        ready.read()
        with pytest.raises(DeviceTimeoutError, match=ready.name):
            ready.read(timeout_s=0.2)
        assert ready.read().status is FrameStatus.OK

    def test_stopping_ends_a_read(self, ready: Camera, clock: Clock):
        ready.configure(frame_rate_hz=1.0)
        ready.start()
        ready.read()
        outcome = Outcome(clock, 0.3, ready.stop)
        with pytest.raises(DeviceTimeoutError, match="stopped"):
            ready.read(timeout_s=100.0)
        outcome.get()
        assert not ready.status().streaming

    def test_closing_ends_the_stream(self, ready: Camera):
        ready.start()
        ready.read()
        ready.close()
        assert not ready.status().streaming
        with pytest.raises(NotConnectedError):
            ready.read()
        ready.connect()
        assert ready.snap().status is FrameStatus.OK
