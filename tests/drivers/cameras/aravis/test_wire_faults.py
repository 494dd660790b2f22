"""Each fault of the wire, on the frames and on the answers of the camera: a named error in time, and never a lie."""

import time
from contextlib import contextmanager
from itertools import pairwise

import pytest

from drivers.emulators.wire import WireFault
from drivers.errors import DeviceError, DeviceTimeoutError, NotConnectedError
from tests.drivers.cameras.aravis.control_line import ADDRESS, control_line
from tests.drivers.gige_rig import drained, is_true, open_camera

pytestmark = pytest.mark.own_network

EXPOSURE_S = 0.002
# with so small packets a frame of which half the packets are lost never comes whole
QUICK = {"exposure_s": EXPOSURE_S, "frame_rate_hz": 50.0, "reconnect_s": [0.2, 1.0], "packet_size_bytes": 1000}
SHORT_S = 0.4
LATE_S = 1.0
SLACK_S = 1.0
QUESTIONS_S = 10.0
"""What Aravis's questions may take beyond a time-out, as the page of the driver tells."""
RECOVERS_S = 30.0


@contextmanager
def within(seconds):
    began_s = time.monotonic()
    yield
    assert time.monotonic() - began_s < seconds


@contextmanager
def faulty(emulator, line):
    """The address of the emulated camera, and the faults of the line."""
    emulator.faults.late_s = LATE_S
    if line == "frames":
        try:
            yield emulator.address, emulator.faults
        finally:
            emulator.faults.clear()
        return
    with control_line(emulator.address) as faults:
        faults.late_s = LATE_S
        yield ADDRESS, faults


def snapped(world, camera, timeout_s=5.0):
    """A frame that was exposed when it was asked for, and shows what is there."""
    asked_ns = time.time_ns()
    frame = camera.snap(timeout_s)
    assert asked_ns <= frame.camera_time_ns - round(5e8 * EXPOSURE_S) <= time.time_ns()
    assert is_true(world, frame)
    return frame


def patiently(call):
    """What a call returns when the camera is back."""
    deadline_s = time.monotonic() + RECOVERS_S
    while True:
        try:
            return call()
        except DeviceError:
            if time.monotonic() > deadline_s:
                raise


@pytest.mark.parametrize("line", ["frames", "control"])
@pytest.mark.parametrize("fault", WireFault)
class TestFaults:
    def test_of_a_snap(self, world, emulator, fault, line):
        packets_only = line == "frames" and fault in (WireFault.GARBLED, WireFault.PARTIAL)
        with faulty(emulator, line) as (address, faults), open_camera(address, **QUICK) as camera:
            frames = [patiently(lambda: snapped(world, camera))]  # the emulator exposes its first frame for long
            faults.inject(fault)
            with (
                within(SHORT_S + SLACK_S + (0.0 if packets_only else QUESTIONS_S)),
                pytest.raises(DeviceTimeoutError, match=r"^primary: "),
            ):
                camera.snap(SHORT_S)
            assert camera.status().lost_frames == 1
            faults.clear()
            frames += [patiently(lambda: snapped(world, camera)) for _ in range(3)]
        assert all(after.frame_id > before.frame_id for before, after in pairwise(frames))

    def test_of_a_stream(self, world, emulator, fault, line):
        options = {**QUICK, "stall_timeout_s": 30.0, "buffer_frames": 1000}
        with faulty(emulator, line) as (address, faults), open_camera(address, **options) as camera:
            patiently(camera.snap)
            before = emulator.sent_frames
            camera.start()
            frames = [camera.read() for _ in range(20)]
            faults.inject(fault)
            if line == "frames":
                with pytest.raises(DeviceTimeoutError, match=r"^primary: reading a frame: none came within 0\.4 s"):
                    while True:
                        with within(SHORT_S + SLACK_S):
                            frames.append(camera.read(SHORT_S))
            else:
                with (
                    within(SLACK_S + 2 * QUESTIONS_S),
                    pytest.raises((DeviceTimeoutError, NotConnectedError), match=r"^primary: "),
                ):
                    camera.configure(gain_db=1.0)
                assert camera.status().gain_db == 0.0
            faults.clear()
            frames += [patiently(lambda: camera.read(1.0)) for _ in range(20)]
            if line == "control":
                patiently(lambda: camera.configure(gain_db=0.5))
                assert camera.status().gain_db == 0.5
                patiently(lambda: camera.read(1.0))
            else:
                last, sent = drained(emulator, camera)
                status = camera.status()
                assert camera.gaps() == ()
                assert status.delivered_frames == len(frames + last)
                assert status.delivered_frames + status.lost_frames == sent - before
        assert all(is_true(world, frame) for frame in frames)
        assert all(after.frame_id > before.frame_id for before, after in pairwise(frames))
