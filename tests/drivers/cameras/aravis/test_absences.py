"""A time without a camera is one gap, however many attempts it takes to set the camera up again."""

import pytest

from drivers.cameras.aravis.device import Device
from drivers.errors import DeviceTimeoutError
from tests.drivers.gige_rig import open_camera, read_until

pytestmark = pytest.mark.own_network

QUICK = {"exposure_s": 0.002, "frame_rate_hz": 50.0, "stall_timeout_s": 0.5, "reconnect_s": [0.2, 0.4]}


@pytest.fixture
def half_booted(monkeypatch):
    """A list: so many times as it has items the camera does not start to acquire."""
    left, start = [], Device.start

    def refuse(device, buffers):
        if left:
            left.pop()
            raise DeviceTimeoutError("primary", "starting to acquire: no answer", "wait")
        return start(device, buffers)

    monkeypatch.setattr(Device, "start", refuse)
    return left


@pytest.mark.parametrize("failures", [0, 1, 3])
def test_attempts_that_fail_do_not_make_the_gap_longer(emulator, half_booted, failures):
    with open_camera(**QUICK) as camera:
        camera.start()
        frames = [camera.read() for _ in range(10)]
        half_booted.extend(range(failures))
        emulator.power_cycle()
        last = frames[-1]
        while (after := read_until(camera, lambda frame: True)).frame_id == last.frame_id + 1:
            last = after
        (gap,) = camera.gaps()
        status = camera.status()
    assert not half_booted
    away_s = 1e-9 * (after.host_time_ns - last.host_time_ns)
    # the first frame comes a trigger's poll and a period after the start
    assert away_s - 0.3 < gap.duration_s < away_s
    assert gap.missing == pytest.approx(50.0 * away_s, abs=15.0)
    assert gap.frame_id == after.frame_id == last.frame_id + 1 + gap.missing
    assert status.lost_frames == gap.missing


def test_an_absence_begins_with_the_last_frame_also_after_a_stall_that_was_looked_into(emulator):
    # a camera that was switched off and on answers questions at once: only its heartbeat tells that it forgot us
    with open_camera(**{**QUICK, "stall_timeout_s": 0.1}) as camera:
        camera.start()
        last = camera.read()
        emulator.power_cycle()
        after = read_until(camera, lambda frame: len(camera.gaps()) == 1)
        (gap,) = camera.gaps()
    assert gap.duration_s == pytest.approx(1e-9 * (after.host_time_ns - last.host_time_ns), abs=0.3)
