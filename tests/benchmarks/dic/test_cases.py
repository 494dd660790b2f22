"""Which points are requested, and what the table makes of errors."""

import numpy as np
import pytest

from tests.benchmarks.bench_dic import Table
from tests.benchmarks.dic.accuracy import Score, coverage, largest_bias_px, over_limit, rms_px
from tests.benchmarks.dic.cases import Case, grid_px, requested
from tests.dic.motions import rotation, translation

SIZE = (60, 50)


def a_score(bias=(0.0, 0.0), std=(1.0, 1.0), limit=(1.0, 1.0), within=0.68):
    bias, std, limit = (np.array(pair, dtype=float) for pair in (bias, std, limit))
    case = Case("", translation(0.0, 0.0))
    return Score(case, 100, 0, 0, bias, std, np.hypot(bias, std), limit, within)


def test_the_grid_is_every_whole_subset_at_the_step():
    points = grid_px(SIZE, step_px=5, subset_px=21)
    assert points.min(axis=0).tolist() == [10, 10]
    assert points.max(axis=0).tolist() == [45, 35]
    assert len(points) == 8 * 6


@pytest.mark.parametrize(
    ("shift", "left_out"),
    [((0.0, 0.0), 0), ((4.0, 0.0), 0), ((4.1, 0.0), 6), ((0.0, -0.1), 8), ((0.0, 4.0), 0), ((-0.1, -0.1), 13)],
)
def test_points_whose_subset_leaves_the_current_image_are_not_requested(shift, left_out):
    points = grid_px(SIZE)
    asked = requested(points, translation(*shift).displacement_px, SIZE)
    assert (~asked).sum() == left_out


def test_a_turned_subset_needs_its_corners_inside():
    middle, corner = np.array([[30, 25]]), np.array([[10, 10]])
    turned = rotation(45.0, SIZE).displacement_px
    assert requested(middle, turned, SIZE).all()
    assert not requested(corner, turned, SIZE).any()


def test_figures_pool_motions_and_take_the_worst_bias():
    run = [a_score(bias=(0.1, -0.3), std=(3.0, 3.0), within=0.6), a_score(std=(1.0, 1.0), within=0.8)]
    assert largest_bias_px(run) == pytest.approx(0.3)
    assert over_limit(run) == pytest.approx(np.sqrt(5.0))
    assert coverage(run) == pytest.approx(0.7)
    assert rms_px(a_score(bias=(3.0, 0.0), std=(4.0, 0.0))) == pytest.approx(5.0 / np.sqrt(2.0))


def test_a_library_that_was_not_measured_has_a_dash():
    table = Table({"bscd": "bscd", "peer": "A peer"})
    table.add("points/s", "6", {"bscd": "7"})
    assert str(table).splitlines() == [
        "| quantity | bscd | A peer | wanted |",
        "| --- | --- | --- | --- |",
        "| points/s | 7 | - | 6 |",
    ]
