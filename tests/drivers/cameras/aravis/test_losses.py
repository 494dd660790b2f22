"""Every frame that the camera sent is delivered or counted as lost, by the emulator's own count and stamps."""

import time

import numpy as np
import pytest

from drivers.emulators.gige.library import FakeCamera
from drivers.interfaces import FrameStatus
from drivers.twin.options import TwinOptions
from drivers.twin.world import World
from tests.drivers.gige_rig import drained, open_camera, serving

pytestmark = pytest.mark.own_network

EXPOSURE_S = 0.002
RATE_HZ = 100.0


@pytest.fixture
def stamps(monkeypatch):
    """The start of each exposure that the emulator sent, ns, in order."""
    sent, fill = [], FakeCamera.fill

    def stamped(fake, buffer, content, time_ns):
        fill(fake, buffer, content, time_ns)
        sent.append(time_ns)

    monkeypatch.setattr(FakeCamera, "fill", stamped)
    return sent


def read_for(camera, seconds):
    """The frames of so many seconds."""
    frames, end_s = [], time.monotonic() + seconds
    while time.monotonic() < end_s:
        frames.append(camera.read(2.0))
    return frames


@pytest.mark.parametrize("ratio", [0.15, 0.5])
@pytest.mark.parametrize("incomplete_frames", ["count", "deliver"])
def test_lost_packets_leave_ids_times_and_the_count_of_losses_true(emulator, stamps, incomplete_frames, ratio):
    options = {"exposure_s": EXPOSURE_S, "frame_rate_hz": RATE_HZ, "stall_timeout_s": 30.0, "buffer_frames": 400}
    with open_camera(**options, incomplete_frames=incomplete_frames) as camera:
        before = emulator.sent_frames
        camera.start()
        frames = read_for(camera, 0.3)  # the buffers have been used, so they have something old to tell
        emulator.lose_packets(ratio)
        frames += read_for(camera, 1.5)
        emulator.lose_packets(0.0)
        frames += read_for(camera, 0.3)
        last, sent_in_all = drained(emulator, camera)
        frames += last
        status, counters = camera.status(), camera.counters()
    sent = sent_in_all - before
    assert status.delivered_frames == len(frames)
    assert status.delivered_frames + status.lost_frames == sent
    assert counters.failed >= counters.incomplete > 10
    ids = [frame.frame_id for frame in frames]
    assert np.all(np.diff(ids) > 0)
    assert (ids[0], ids[-1]) == (0, sent - 1)
    good = [frame for frame in frames if frame.status is FrameStatus.OK]
    middles = [stamps[frame.frame_id] + round(5e8 * EXPOSURE_S) for frame in good]
    assert [frame.camera_time_ns for frame in good] == middles
    parts = [frame for frame in frames if frame.status is FrameStatus.INCOMPLETE]
    assert len(parts) == (counters.incomplete if incomplete_frames == "deliver" else 0)
    assert np.all(np.diff([frame.camera_time_ns for frame in frames]) > 0)


def test_at_the_highest_rate_every_loss_is_counted(record_property):
    world = World(TwinOptions())
    world.irradiance("primary")
    options = {"exposure_s": 1e-4, "frame_rate_hz": 1000.0, "buffer_frames": 64, "stream_buffers": 64}
    with serving(world) as emulator, open_camera(**options, stall_timeout_s=30.0) as camera:
        before, began_s = emulator.sent_frames, time.monotonic()
        camera.start()
        frames = read_for(camera, 4.0)
        took_s, read = time.monotonic() - began_s, len(frames)
        last, sent_in_all = drained(emulator, camera)
        frames += last
        status, sent = camera.status(), sent_in_all - before
    world.close()
    rate = {"frames_per_s": read / took_s, "megabytes_per_s": 1e-6 * read * frames[0].data.nbytes / took_s}
    losses = {"sent_frames": sent, "lost_frames": status.lost_frames}
    for name, value in {**rate, **losses}.items():
        record_property(name, value)
    print({**rate, **losses})
    assert frames[0].data.shape == (1024, 1280)
    assert status.delivered_frames == len(frames) > 100
    assert status.delivered_frames + status.lost_frames == sent
    assert np.all(np.diff([frame.frame_id for frame in frames]) > 0)
    assert frames[-1].frame_id == sent - 1
