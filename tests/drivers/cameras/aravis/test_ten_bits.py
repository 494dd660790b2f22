"""A 10 bit camera over the wire, in each of its formats."""

import numpy as np
import pytest

from tests.drivers.gige_rig import open_camera, serving, small_world

pytestmark = pytest.mark.own_network


@pytest.fixture(scope="module")
def ten_bits():
    world = small_world(bits=10)
    with serving(world):
        yield world
    world.close()


@pytest.mark.parametrize("pixel_format", ["Mono10", "Mono10Packed", "Mono10p"])
def test_every_format_shows_the_same_image(ten_bits, pixel_format):
    with open_camera(pixel_format=pixel_format) as camera:
        assert camera.info().bit_depth == 10
        frame = camera.snap()
    assert frame.data.dtype == np.uint16
    assert 256 < int(frame.data.max()) < 1024
    noise = frame.data / 1023 - ten_bits.irradiance("primary")
    assert abs(noise.mean()) < 0.005
    assert np.std(noise) < 0.02
