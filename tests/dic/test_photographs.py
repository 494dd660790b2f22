"""MultiDIC's photographs of a speckled cylinder: our matches beside its own, and the cylinder's radius."""

import cv2
import numpy as np
import pytest

from tests.benchmarks.dic.photograph_outlines import outline_radius_mm
from tests.benchmarks.dic.photographs import (
    FRAMES,
    LEFT,
    RADIUS_MM,
    RIGHT,
    Photographs,
    apart_px,
    fit_cylinder,
    rigid_residual_mm,
)

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def photographs(real_data):
    return Photographs.load(real_data)


@pytest.fixture(scope="module")
def ours(photographs):
    """As MultiDIC matched: first order, subsets of as many pixels."""
    return photographs.matched("affine")


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize(("camera", "median_px"), [(LEFT, 0.01), (RIGHT, 0.025)])
def test_matches_are_those_of_multidic(photographs, ours, camera, frame, median_px):
    apart = apart_px(ours[camera, frame], photographs.stored[camera, frame])
    assert len(apart) > 0.999 * len(photographs.points_px)
    assert np.median(apart) <= median_px
    assert np.quantile(apart, 0.95) <= 0.05
    assert apart.max() <= 0.25


def test_pixels_are_counted_from_0_here_and_from_1_there(photographs):
    """Ncorr's grid of every 12th pixel begins at the corner pixel."""
    steps = photographs.points_px / 12.0
    assert np.allclose(steps, np.rint(steps))


@pytest.mark.parametrize("frame", FRAMES)
def test_the_radius_is_the_calibration_cylinders(photographs, ours, frame):
    """Lens distortion of 3 px rms is in the DLT: the calibration's own marks come back with 57.6 mm."""
    found = fit_cylinder(photographs.surface(ours, frame))
    published = fit_cylinder(photographs.surface(photographs.stored, frame))
    assert found.radius_mm == pytest.approx(RADIUS_MM, rel=0.01)
    assert found.radius_mm == pytest.approx(published.radius_mm, abs=0.03)
    assert found.std_mm <= fit_cylinder(photographs.marks_mm()).std_mm


def test_both_cylinders_have_one_radius_by_their_outlines(photographs, real_data):
    """What lets the speckled cylinder be held to the calibration's: no match takes part."""

    def radius_mm(path):
        seen = {c: cv2.imread(str(real_data / path.format(c)), cv2.IMREAD_GRAYSCALE) for c in (LEFT, RIGHT)}
        return outline_radius_mm(photographs.matrices, seen)

    calibration, speckled = radius_mm("multidic-dlt/{0}.jpg"), radius_mm("multidic-speckle/{0}/{0}_1.jpg")
    assert calibration == pytest.approx(RADIUS_MM, rel=0.01)
    assert speckled == pytest.approx(calibration, rel=0.003)


def test_the_cylinder_moves_as_a_whole(photographs, ours):
    first, last = (photographs.surface(ours, frame) for frame in (FRAMES[0], FRAMES[-1]))
    assert np.linalg.norm(np.nanmedian(last - first, axis=0)) > 1.5
    assert rigid_residual_mm(first, last).std(axis=0).max() < 0.02


def test_first_order_errs_with_the_subsets_area(photographs):
    """What second order takes out is a bias of the curved surface, which MultiDIC's matches have as well."""
    second = photographs.matched("quadratic", 31, frames=1)[RIGHT, 1]

    def bias_px(positions):
        return float(np.nanmean((positions - second)[:, 0]))

    small, large = (bias_px(photographs.matched("affine", subset_px, frames=1)[RIGHT, 1]) for subset_px in (27, 37))
    assert 0.05 < small < large
    assert large / small == pytest.approx((37**2 - 1) / (27**2 - 1), rel=0.2)
    assert bias_px(photographs.stored[RIGHT, 1]) == pytest.approx(large, rel=0.2)
    for shape in ("quadratic", "curved"):
        assert abs(bias_px(photographs.matched(shape, frames=1)[RIGHT, 1])) < 0.1 * large


def test_as_it_is_by_default_it_differs_by_that_bias_alone(photographs):
    found = photographs.matched("curved", 21, frames=1)[RIGHT, 1]
    assert np.median(apart_px(found, photographs.stored[RIGHT, 1])) <= 0.12
    second = photographs.matched("quadratic", 31, frames=1)[RIGHT, 1]
    assert np.median(apart_px(found, second)) <= 0.06


def test_small_subsets_of_few_shapes_are_not_taken_for_others(photographs):
    """The pattern is 0.992 like itself 130 px farther on the epipolar curve; a subset of 21 px may see no more."""
    found = photographs.matched("quadratic", 21, frames=1)[RIGHT, 1]
    apart = apart_px(found, photographs.stored[RIGHT, 1])
    assert len(apart) > 0.99 * len(found)
    assert apart.max() < 2.0  # at the region's border half a subset is left
