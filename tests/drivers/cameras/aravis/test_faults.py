"""What goes wrong on the wire ends in a named error within its time, and ends when the fault ends."""

import logging
import time

import numpy as np
import pytest

from drivers.emulators.wire import WireFault
from drivers.errors import DeviceBusyError, DeviceTimeoutError, NotConnectedError
from drivers.interfaces import FrameStatus
from tests.drivers.gige_rig import drained, is_true, open_camera, read_until

pytestmark = pytest.mark.own_network

QUICK = {"exposure_s": 0.002, "frame_rate_hz": 50.0, "stall_timeout_s": 0.5, "reconnect_s": [0.2, 1.0]}


@pytest.fixture(autouse=True)
def whole(emulator):
    yield
    emulator.faults.clear()
    emulator.lose_packets(0.0)
    emulator.plug_in()


def test_silence_times_out_and_the_stream_goes_on(world, emulator):
    with open_camera(**{**QUICK, "stall_timeout_s": 30.0}) as camera:
        camera.start()
        last = camera.read()
        emulator.faults.inject(WireFault.SILENCE)
        began_s = time.monotonic()
        with pytest.raises(DeviceTimeoutError, match="primary: reading a frame: none came within 0"):
            for _ in range(20):
                last = camera.read(0.5)
        assert time.monotonic() - began_s < 1.5
        emulator.faults.clear()
        after = camera.read(2.0)
        assert is_true(world, after)
        assert after.frame_id == last.frame_id + 1


@pytest.mark.parametrize("incomplete_frames", ["count", "deliver"])
def test_lost_packets_are_never_passed_as_good(world, emulator, incomplete_frames):
    with open_camera(**QUICK, incomplete_frames=incomplete_frames, buffer_frames=64) as camera:
        before = emulator.sent_frames
        camera.start()
        first = camera.read()
        emulator.lose_packets(0.15)
        frames = [camera.read() for _ in range(20)]
        emulator.lose_packets(0.0)
        camera.read()
        good = [frame for frame in frames if frame.status is FrameStatus.OK]
        assert good and all(is_true(world, frame) for frame in good)
        status, counters = camera.status(), camera.counters()
        jumps = frames[-1].frame_id - first.frame_id - len(frames)
        assert counters.incomplete + counters.missing > 0
        assert counters.missing_packets > 0
        if incomplete_frames == "count":
            assert len(good) == len(frames)
            assert status.lost_frames >= jumps > 0
        else:
            assert len(good) < len(frames)
            assert status.lost_frames >= jumps
        _, sent = drained(emulator, camera)
        status = camera.status()
        assert status.delivered_frames + status.lost_frames == sent - before


def test_a_lost_packet_of_a_snap_is_named(world, emulator):
    # with so small packets a frame of which half the packets are lost never comes whole
    with open_camera(**QUICK, packet_size_bytes=1000) as camera:
        emulator.faults.inject(WireFault.PARTIAL, count=1)
        with pytest.raises(DeviceTimeoutError, match="primary: taking a frame"):
            camera.snap(timeout_s=2.0)
        assert camera.status().lost_frames == 1
        assert is_true(world, camera.snap())


def test_an_unplugged_camera_is_reported_once_and_comes_back_as_it_was(world, emulator, caplog):
    caplog.set_level(logging.WARNING)
    with open_camera(**QUICK, region_px=[20, 10, 100, 80]) as camera:
        camera.configure(exposure_s=0.003, gain_db=2.0)
        camera.start()
        last = camera.read()
        before = camera.status()
        emulator.unplug()
        deadline_s = time.monotonic() + 15.0
        while camera.status().connected:
            assert time.monotonic() < deadline_s
            with pytest.raises((DeviceTimeoutError, NotConnectedError)):
                while True:
                    last = camera.read(0.5)
        with pytest.raises(NotConnectedError, match="primary: reading a frame: the camera is lost") as raised:
            camera.read(0.2)
        assert "no answer" in str(raised.value) or "heartbeat" in str(raised.value)
        with pytest.raises(NotConnectedError, match="the camera is lost"):
            camera.configure(gain_db=1.0)
        emulator.plug_in()
        after = read_until(camera, lambda frame: True)
        assert after.data.shape == (80, 100)
        status = camera.status()
        assert status.connected and status.streaming
        assert (status.exposure_s, status.gain_db) == (before.exposure_s, before.gain_db)
        (gap,) = camera.gaps()
        assert gap.frame_id == after.frame_id == last.frame_id + gap.missing + 1
        assert gap.missing == pytest.approx(50.0 * gap.duration_s, abs=2.0)
        assert status.lost_frames >= gap.missing
        camera.stop()
        assert camera.snap().status is FrameStatus.OK
    said = [record.message for record in caplog.records if record.name.startswith("drivers.cameras.aravis")]
    assert [("lost:" in text, "back after" in text) for text in said] == [(True, False), (False, True)]


def test_a_power_cycle_is_noticed_and_mended(world, emulator):
    with open_camera(**QUICK) as camera:
        camera.start()
        before = camera.read()
        emulator.power_cycle()
        after = read_until(camera, lambda frame: len(camera.gaps()) == 1)
        assert after.frame_id > before.frame_id + 1
        assert is_true(world, after)
        ids = [camera.read().frame_id for _ in range(10)]
        assert np.diff(ids).tolist() == [1] * 9
        assert camera.status().exposure_s == pytest.approx(0.002)


def test_a_camera_lost_at_rest_is_noticed_too(emulator):
    with open_camera(**QUICK) as camera:
        emulator.power_cycle()
        deadline_s = time.monotonic() + 15.0
        while camera.status().connected:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        while not camera.status().connected:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        assert camera.snap().status is FrameStatus.OK
        assert camera.gaps() == ()


def test_a_closed_camera_is_free_also_while_an_error_of_it_is_kept(emulator):
    with open_camera(**QUICK) as camera:
        emulator.faults.inject(WireFault.GARBLED)
        with pytest.raises(DeviceTimeoutError) as kept:
            camera.snap(timeout_s=0.5)
        emulator.faults.clear()
    with open_camera(**QUICK, name="second", open_timeout_s=0.5) as camera:
        assert camera.snap().status is FrameStatus.OK
    assert kept.value.__traceback__ is not None


def test_closing_a_lost_camera_returns(emulator):
    with open_camera(**QUICK) as camera:
        camera.start()
        camera.read()
        emulator.unplug()
        deadline_s = time.monotonic() + 15.0
        while camera.status().connected:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        began_s = time.monotonic()
        camera.close()
        assert time.monotonic() - began_s < 15.0
        assert not camera.status().streaming


def test_a_camera_that_another_program_took_meanwhile_is_not_fought_over(world, emulator):
    with open_camera(**QUICK, open_timeout_s=0.1) as camera:
        emulator.unplug()
        deadline_s = time.monotonic() + 15.0
        while camera.status().connected:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        emulator.plug_in()
        # whoever is first has it: the other is told so, or waits
        try:
            with open_camera(name="other", open_timeout_s=0.1) as other:
                assert is_true(world, _at_two_ms(other))
                assert not camera.status().connected
        except DeviceBusyError:
            assert camera.status().connected
        deadline_s = time.monotonic() + 15.0
        while not camera.status().connected:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        assert is_true(world, camera.snap())


def _at_two_ms(camera):
    camera.configure(exposure_s=0.002)
    return camera.snap()
