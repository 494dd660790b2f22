"""The membrane's frame on flat, spherical and inflated shapes that stand where the test puts them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bscd.analysis.surface import MembraneFrame
from bscd.errors import InputError
from tests.analysis.surface.shapes import FACING, MembraneField, turned

CENTRE = np.array([0.6, 8.0, 0.0])
AXES = FACING @ turned([0.6, 0.3, -0.8]).T


def disc(radius_mm=14.4, step_mm=0.55, cap_radius_mm=np.inf, where=None):
    """Points ``(N, 3)`` of a flat or spherical cap in its own frame, its pole in the origin."""
    line = np.arange(-40, 41) * step_mm + 0.1
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    kept = np.hypot(x, y) < radius_mm
    if where is not None:
        kept &= where(x, y)
    x, y = x[kept], y[kept]
    bend = 0.0 if np.isinf(cap_radius_mm) else 1.0 / cap_radius_mm
    z = -bend * (x**2 + y**2) / (1.0 + np.sqrt(1.0 - bend**2 * (x**2 + y**2)))
    return np.stack([x, y, z], axis=1)


def off(frame):
    """Origin in the true frame, mm, and the tilt of z' from the true one along x', y', mrad."""
    return (frame.origin_mm - CENTRE) @ AXES.T, 1e3 * (frame.axes[2] @ AXES.T)[:2]


@pytest.mark.parametrize("cap_radius_mm", [np.inf, 1e6, 1000.0, 120.0, 25.0, -120.0])
def test_axes_and_origin_of_an_exact_cap_whose_centre_is_given(cap_radius_mm):
    points = disc(cap_radius_mm=cap_radius_mm) @ AXES + CENTRE
    frame = MembraneFrame.fit(points, centre_mm=CENTRE)
    np.testing.assert_allclose(frame.origin_mm, CENTRE, atol=1e-8)
    np.testing.assert_allclose(frame.axes[2], AXES[2], atol=1e-9)
    np.testing.assert_allclose(frame.axes @ frame.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame.axes) == pytest.approx(1.0)
    assert frame.axes[0, 0] > 0.99
    assert frame.axes[0] @ np.cross([1.0, 0.0, 0.0], frame.axes[2]) == pytest.approx(0.0, abs=1e-12)
    assert 1.0 / frame.cap_radius_mm == pytest.approx(1.0 / cap_radius_mm, abs=1e-9)
    assert frame.centre_from == "given"
    assert frame.rms_mm < 1e-9
    np.testing.assert_allclose(frame.points(points), (points - frame.origin_mm) @ frame.axes.T, atol=1e-12)
    np.testing.assert_allclose(frame.vectors(np.array([frame.axes[2]]) * 6.0), [[0.0, 0.0, 6.0]], atol=1e-12)


def test_facing_the_camera_u_is_right_v_is_up_and_w_towards_it():
    frame = MembraneFrame.fit(disc() @ FACING)
    np.testing.assert_allclose(frame.axes, FACING, atol=1e-9)
    away = MembraneFrame.fit(disc() @ FACING, towards=(0.0, 1.0, 0.0))
    np.testing.assert_allclose(away.axes, [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("cap_radius_mm", [np.inf, 120.0])
@pytest.mark.parametrize(
    ("where", "centre_from"),
    [
        (None, "circle"),
        (lambda x, y: x < 8.0, "circle"),
        (lambda x, y: np.abs(x) < 11.5, "circle"),
        (lambda x, y: (x - 4.0) ** 2 + (y + 3.0) ** 2 > 4.0, "circle"),
        (lambda x, y: (np.abs(x) < 8.0) & (np.abs(y) < 6.0), "outline"),
    ],
    ids=["whole", "cut", "strip", "hole", "rectangle"],
)
def test_the_origin_is_the_middle_of_the_window_that_the_outline_shows(where, centre_from, cap_radius_mm):
    rng = np.random.default_rng(1)
    points = disc(where=where, cap_radius_mm=cap_radius_mm) @ AXES + CENTRE
    frame = MembraneFrame.fit(points + 0.006 * rng.normal(size=points.shape))
    assert frame.centre_from == centre_from
    origin, tilt = off(frame)
    near = 0.15 if centre_from == "circle" else 0.3  # of the points' spacing of 0.55 mm
    assert np.hypot(*origin[:2]) < near
    assert abs(origin[2]) < 0.003
    assert np.hypot(*tilt) < 0.15 + 1e3 * near / cap_radius_mm
    assert frame.rms_mm == pytest.approx(0.006, rel=0.1)
    if centre_from == "circle":
        assert 0.0 < frame.centre_sigma_mm < 0.1
        assert frame.outline_radius_mm == pytest.approx(14.3, abs=0.25)
    else:
        assert np.isnan([frame.centre_sigma_mm, frame.outline_radius_mm]).all()


def test_noise_and_outliers_do_not_bend_a_flat_membrane():
    rng = np.random.default_rng(2)
    points = disc() @ AXES + CENTRE
    points = points + 0.006 * rng.normal(size=points.shape)
    bad = rng.permutation(len(points))[: len(points) // 5]
    points[bad] += rng.uniform(0.5, 5.0, (len(bad), 1)) * AXES[2]
    points[::37] = np.nan
    frame = MembraneFrame.fit(points)
    origin, tilt = off(frame)
    assert abs(1.0 / frame.cap_radius_mm) < 1e-4
    assert np.abs(tilt).max() < 0.15
    assert np.hypot(*origin[:2]) < 0.15


@pytest.mark.parametrize("pressure_kpa", [0.05, 1.0])
@pytest.mark.parametrize("edge_mm", [14.4, 8.0])
def test_the_clamped_membrane_is_no_sphere_and_still_stands_upright(pressure_kpa, edge_mm):
    """Cut off on one side, so that what a sphere can not follow could tilt it; 0.8 mrad are 0.005 mm of 6 mm."""
    field = MembraneField(pressure_kpa, step_px=10.0)
    points = field.current[field.reference[:, 0] < edge_mm] @ AXES + CENTRE
    noise = 0.006 * np.random.default_rng(3).normal(size=points.shape)
    _, tilt = off(MembraneFrame.fit(points + noise, centre_mm=CENTRE))
    assert np.hypot(*tilt) < 0.15
    frame = MembraneFrame.fit(points + noise)
    origin, tilt = off(frame)
    assert frame.centre_from == "circle"
    assert np.hypot(*origin[:2]) < 0.1
    assert np.hypot(*tilt) < 0.15 + 1e3 * 0.1 / frame.cap_radius_mm


@settings(max_examples=6, deadline=None)
@given(st.tuples(*[st.floats(-25.0, 25.0)] * 3), st.tuples(*[st.floats(-50.0, 50.0)] * 3))
def test_coordinates_in_the_frame_do_not_know_where_the_membrane_stands(turn_deg, shift_mm):
    points = disc(step_mm=1.1, cap_radius_mm=120.0)
    points = (points + 0.1 * np.random.default_rng(4).normal(size=points.shape)) @ FACING  # no two are as far out
    rotation = turned(turn_deg)
    moved = points @ rotation.T + shift_mm
    frames = MembraneFrame.fit(points), MembraneFrame.fit(moved, x_axis=rotation[:, 0], towards=-rotation[:, 1])
    np.testing.assert_allclose(frames[1].points(moved), frames[0].points(points), atol=1e-6)


@pytest.mark.parametrize(
    ("points", "options", "says"),
    [
        (np.zeros((30, 2)), {}, "points \\(N, 3\\)"),
        (disc()[:19], {}, "at least 20 points; 19 are known"),
        (np.outer(np.arange(30.0), [1.0, 0.0, 0.5]), {}, "on a line"),
        (disc() @ FACING, {"x_axis": (0.0, 1.0, 0.0)}, "x_axis must not be normal"),
        (disc() @ FACING, {"towards": (1.0, 0.0, 0.0)}, "towards must not lie in"),
        (disc() @ FACING, {"centre_mm": np.array([0.0, np.nan, 0.0])}, "three finite numbers"),
    ],
)
def test_what_has_no_frame_is_refused(points, options, says):
    with pytest.raises(InputError, match=says):
        MembraneFrame.fit(points, **options)
