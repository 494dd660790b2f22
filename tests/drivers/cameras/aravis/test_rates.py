"""Full frames over GVSP at the rig's rate: none lost, ids in order across the 16 bit wrap, two cameras at once."""

import numpy as np
import pytest

from drivers.emulators.gige import GigeEmulator, serve_cameras
from drivers.twin.options import TwinOptions
from drivers.twin.world import World
from tests.drivers.gige_rig import open_camera, require_aravis, serving, simulated
from tests.drivers.own_network import one_at_a_time

pytestmark = pytest.mark.own_network


@pytest.fixture(scope="module")
def full_world():
    world = World(TwinOptions())
    for name in ("primary", "auxiliary"):
        world.irradiance(name)
    yield world
    world.close()


def assert_none_lost(camera, frames):
    assert np.diff([frame.frame_id for frame in frames]).tolist() == [1] * (len(frames) - 1)
    counters = camera.counters()
    assert camera.status().lost_frames == 0
    assert (counters.failed, counters.underrun, counters.missing_packets) == (0, 0, 0)
    assert counters.delivered == len(frames)
    assert 0 <= counters.completed - len(frames) <= 16


@pytest.mark.parametrize("seconds", [10, pytest.param(60, marks=[pytest.mark.slow, pytest.mark.timeout(300)])])
def test_eleven_full_frames_a_second_lose_none(full_world, seconds):
    with serving(full_world), open_camera(frame_rate_hz=11.0) as camera:
        assert (camera.info().width_px, camera.info().height_px) == (1280, 1024)
        camera.start()
        frames = [camera.read() for _ in range(11 * seconds)]
        assert_none_lost(camera, frames)


@pytest.mark.parametrize("seconds", [5, pytest.param(60, marks=[pytest.mark.slow, pytest.mark.timeout(300)])])
def test_two_cameras_at_once_lose_none(full_world, seconds):
    require_aravis()
    with one_at_a_time():
        served = serve_cameras([simulated(full_world, name) for name in ("primary", "auxiliary")])
        try:
            if served.missing:
                pytest.skip(served.missing[0])
            with open_camera("127.0.0.1") as first, open_camera("127.0.0.2", name="auxiliary") as second:
                assert second.info().serial == "twin-auxiliary"
                first.start()
                second.start()
                pairs = [(first.read(), second.read()) for _ in range(11 * seconds)]
                assert_none_lost(first, [pair[0] for pair in pairs])
                assert_none_lost(second, [pair[1] for pair in pairs])
        finally:
            served.stop()


def test_ids_run_on_across_the_wrap_of_sixteen_bits(world):
    # the fake camera begins at 65401: the 136th frame is beyond 65535
    with serving(world), open_camera(exposure_s=0.001, frame_rate_hz=100.0, buffer_frames=200) as camera:
        camera.start()
        ids = [camera.read().frame_id for _ in range(160)]
        assert np.diff(ids).tolist() == [1] * 159
        assert camera.status().lost_frames == 0
        # the camera did wrap: its raw id is small now
        assert camera._connection._count._last_raw < 100


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_ids_of_a_minute_at_the_rigs_rate_run_on_across_the_wrap(full_world):
    with serving(full_world), open_camera(frame_rate_hz=11.0) as camera:
        camera.start()
        ids = [camera.read().frame_id for _ in range(660)]
        assert np.diff(ids).tolist() == [1] * 659
        assert camera._connection._count._last_raw < 1000


def test_a_taken_address_is_an_error(full_world):
    with serving(full_world):
        second = GigeEmulator(simulated(full_world, "auxiliary"), "127.0.0.1")
        with pytest.raises(OSError, match="is taken"):
            second.start()
        second.stop()
