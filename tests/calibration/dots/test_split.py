"""The split line against the trace's own: seen where it cuts dots, else in the gap."""

import numpy as np
import pytest

from bscd.calibration.dots import find_split
from bscd.errors import CheckFailedError, InputError
from tests.calibration.dots.twin_views import FACE_DEG, LOWERED, RAISED, expose, side_of, true_split, truth, twin

TILTED = {"tilt_deg": (0.4, -1.2, 0.1), "edge_mm": (1.5, -210.0, 0.0)}


@pytest.mark.parametrize(
    ("rotation_deg", "shift_mm", "prism"),
    [(45.0, (5.0, 0, 0), {}), (45.0, (-6.0, 0, 0), TILTED), (FACE_DEG, (9.7, 0, 0), {})],
)
def test_seen_where_it_cuts_dots(rotation_deg, shift_mm, prism):
    world = twin(rotation_deg, jack_mm=RAISED, shift_mm=shift_mm, prism=prism)
    line, true = find_split([expose(world)]), true_split(world)
    assert line.found
    assert abs(line.column_px - true.column_px) < 0.7
    assert abs(line.tilt - true.tilt) < 0.001
    assert line.sigma_px < 1.0


def test_a_scan_agrees_and_one_image_may_be_given_bare():
    images = [expose(twin(jack_mm=RAISED, shift_mm=(5.0, 0, 0), translation_mm=50.0 + y)) for y in (-16.0, 0.0, 16.0)]
    true = true_split(twin(jack_mm=RAISED))
    line = find_split(images)
    assert line.found
    assert abs(line.column_px - true.column_px) < 0.7
    assert abs(find_split(images[1]).column_px - line.column_px) < 0.7


@pytest.mark.parametrize("rotation_deg", [45.0, FACE_DEG])
def test_where_it_cuts_nothing_the_gap_serves(rotation_deg):
    world = twin(rotation_deg, jack_mm=RAISED)
    line = find_split([expose(world)])
    assert not line.found
    for half, sign in (("left", -1), ("right", 1)):
        dots = truth(world, side=side_of(world, half))
        seen = dots.xy_px[dots.visible]
        assert (sign * (seen[:, 0] - line.column_at(seen[:, 1])) > 10).all()
    assert abs(line.column_px - true_split(world).column_px) < 3 * line.sigma_px


def test_without_the_prism_there_is_none():
    with pytest.raises(CheckFailedError, match="biprism is raised"):
        find_split([expose(twin(FACE_DEG, jack_mm=LOWERED))])


def test_bad_input():
    with pytest.raises(InputError, match="no image"):
        find_split([])
    with pytest.raises(InputError, match="differ in size"):
        find_split([np.zeros((100, 100), np.uint8), np.zeros((100, 120), np.uint8)])
