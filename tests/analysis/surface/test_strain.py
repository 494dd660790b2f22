"""Green-Lagrange strain on deformations in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bscd.analysis.surface import MembraneFrame, StrainGauge, StrainSettings, StrainStatus, surface_strain
from bscd.errors import InputError
from tests.analysis.surface.shapes import FACING, SCALE_MM, grid, tensor, turned

POINTS_PX, PLANE_MM = grid(18)


def bent(points_mm, radius_mm=25.0):
    """A plane's points on a spherical cap that bulges towards the camera (not an isometry)."""
    x, _, z = points_mm.T
    return np.stack([x, -np.sqrt(radius_mm**2 - x**2 - z**2) + radius_mm, z], axis=1)


def valid(result):
    return result.status == StrainStatus.VALID


@settings(max_examples=20, deadline=None)
@given(
    st.tuples(*[st.floats(-180.0, 180.0)] * 3),
    st.tuples(*[st.floats(-100.0, 100.0)] * 3),
    st.integers(0, 2**16),
)
def test_a_rigid_motion_gives_no_strain(turn_deg, shift_mm, seed):
    """Of a curved and rough surface, with points missing, though depth has a degree of its own."""
    rng = np.random.default_rng(seed)
    reference = bent(PLANE_MM) + 0.01 * rng.normal(size=PLANE_MM.shape)
    current = reference @ turned(turn_deg).T + shift_mm
    current[rng.permutation(len(current))[:40]] = np.nan
    result = StrainGauge(POINTS_PX, reference).measure(current)
    assert valid(result).sum() > 300
    assert np.abs(result.strain[valid(result)]).max() < 1e-9


@settings(max_examples=10, deadline=None)
@given(st.tuples(*[st.floats(-180.0, 180.0)] * 3), st.tuples(*[st.floats(-100.0, 100.0)] * 3))
def test_strain_does_not_know_how_the_body_moved_on(turn_deg, shift_mm):
    gauge = StrainGauge(POINTS_PX, bent(PLANE_MM, 120.0))
    current = bent(1.1 * PLANE_MM, 18.0)
    first, moved = gauge.measure(current), gauge.measure(current @ turned(turn_deg).T + shift_mm)
    np.testing.assert_allclose(moved.strain, first.strain, atol=1e-9)


@pytest.mark.parametrize("turn_deg", [(0.0, 0.0, 0.0), (12.0, -7.0, 31.0)])
def test_a_homogeneous_deformation_of_a_plane_is_exact(turn_deg):
    """Stretch and shear in x' (right) and y' (up), wherever the plane stands; a camera that sees it obliquely."""
    deformation = np.array([[1.15, 0.08], [-0.02, 0.95]])
    rotation = turned(turn_deg)
    local = np.stack([PLANE_MM[:, 0], PLANE_MM[:, 2]], axis=1)
    reference = PLANE_MM @ rotation.T
    moved = local @ deformation.T
    current = np.stack([moved[:, 0], 0.0 * moved[:, 0], moved[:, 1]], axis=1) @ rotation.T @ turned((3, 2, 1)).T
    expected = (deformation.T @ deformation - np.eye(2)) / 2.0
    frame = MembraneFrame.fit(reference, x_axis=rotation[:, 0], towards=-rotation[:, 1])
    oblique_px = POINTS_PX * [0.8, 1.0] + 0.1 * POINTS_PX[:, ::-1]
    for points_px in (POINTS_PX, oblique_px):
        result = StrainGauge(points_px, reference, frame=frame).measure(current)
        found = result.strain[valid(result)]
        assert len(found) > 300
        np.testing.assert_allclose(found, np.tile([expected[0, 0], expected[1, 1], expected[0, 1]], (len(found), 1)))
        values, vectors = np.linalg.eigh(expected)
        np.testing.assert_allclose(result.principal[valid(result)], np.tile(values[::-1], (len(found), 1)))
        angle = np.degrees(np.arctan(vectors[1, 1] / vectors[0, 1]))
        np.testing.assert_allclose(result.angle_deg[valid(result)], angle)


def test_without_a_frame_the_axes_are_right_and_up_as_the_camera_sees_them():
    current = PLANE_MM + 0.1 * PLANE_MM[:, 2:] * [1.0, 0.0, 0.0]  # the upper part moves right
    result = StrainGauge(POINTS_PX, PLANE_MM).measure(current)
    np.testing.assert_allclose(
        result.strain[valid(result)], np.tile([0.0, 0.005, 0.05], (valid(result).sum(), 1)), atol=1e-12
    )
    away = MembraneFrame(np.zeros(3), np.diag([1.0, -1.0, -1.0]) @ FACING, "given", np.nan, np.nan, np.inf, 0.0)
    behind = StrainGauge(POINTS_PX, PLANE_MM, frame=away).measure(current)
    np.testing.assert_allclose(behind.strain[valid(behind), 2], -0.05, atol=1e-12)


def test_bending_a_plane_round_a_cylinder_strains_nothing():
    angle = PLANE_MM[:, 0] / 20.0
    rolled = np.stack([20.0 * np.sin(angle), 20.0 * (1.0 - np.cos(angle)), PLANE_MM[:, 2]], axis=1)
    result = StrainGauge(POINTS_PX, PLANE_MM).measure(rolled)
    assert np.abs(result.strain[valid(result)]).max() < 2e-4  # the cubic along, the parabola in depth


def test_a_cylinder_that_widens_strains_round_its_axis():
    angle = PLANE_MM[:, 0] / 20.0
    reference = np.stack([20.0 * np.sin(angle), -20.0 * np.cos(angle), PLANE_MM[:, 2]], axis=1)
    result = StrainGauge(POINTS_PX, reference).measure(reference * [1.1, 1.1, 0.97])
    inside = valid(result)
    hoop, axial = (1.1**2 - 1.0) / 2.0, (0.97**2 - 1.0) / 2.0
    np.testing.assert_allclose(result.strain[inside], np.tile([hoop, axial, 0.0], (inside.sum(), 1)), atol=1e-6)


@pytest.mark.parametrize("frame", [None, "fitted"])
def test_a_disc_drawn_over_a_sphere(frame):
    """Equidistant: no strain along meridians, hoop stretch sin(t) / t at the polar angle t = r / R."""
    x, z = PLANE_MM[:, 0], PLANE_MM[:, 2]
    r, phi = np.hypot(x, z), np.arctan2(z, x)
    polar = r / 15.0
    ring = 15.0 * np.sin(polar)
    current = np.stack([ring * np.cos(phi), 15.0 * (np.cos(polar) - 1.0) * -1.0, ring * np.sin(phi)], axis=1)
    fitted = None if frame is None else MembraneFrame.fit(PLANE_MM)
    result = StrainGauge(POINTS_PX, PLANE_MM, frame=fitted).measure(current)
    hoop = (np.sinc(polar / np.pi) ** 2 - 1.0) / 2.0
    expected = tensor(0.0, hoop, np.cos(phi), np.sin(phi))
    inside = valid(result)
    np.testing.assert_allclose(result.strain[inside], expected[inside], atol=5e-4)
    np.testing.assert_allclose(result.principal[inside], np.stack([0.0 * hoop, hoop], axis=1)[inside], atol=5e-4)
    far = inside & (r > 3.0)
    turn = np.cos(np.radians(2.0 * (result.angle_deg[far] - np.degrees(phi[far]))))
    assert turn.min() > np.cos(np.radians(8.0))


def test_all_frames_at_once_are_the_frames_one_by_one():
    frames = np.stack([PLANE_MM * (1.0 + 0.01 * k) for k in range(4)])
    frames[1, 700] = np.nan
    frames[2, 700] = np.nan
    frames[3, 20] = np.nan
    sigma = np.full(frames.shape, 0.002)
    together, window = surface_strain(POINTS_PX, PLANE_MM, frames, sigma_mm=sigma)
    assert together.strain.shape == (4, len(POINTS_PX), 3)
    assert window.window_points == 17
    for k in (3, 1, 0, 2):
        alone = StrainGauge(POINTS_PX, PLANE_MM).measure(frames[k], sigma[k])
        for name in ("strain", "principal", "angle_deg", "sigma", "status"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name)[k])


def test_where_there_is_no_strain_the_status_says_why():
    reference, current = PLANE_MM.copy(), PLANE_MM.copy()
    side = 37
    middle = side * 18 + 18
    current[middle] = np.nan
    reference[middle + 3] = np.nan
    corner = (POINTS_PX[:, 0] > 20.0) & (POINTS_PX[:, 1] > 20.0)
    lone = np.flatnonzero(corner)[130]
    current[corner] = np.nan
    current[lone] = reference[lone]
    result = StrainGauge(POINTS_PX, reference).measure(current)
    assert result.status[middle] == StrainStatus.UNMEASURED
    assert result.status[middle + 3] == StrainStatus.UNMEASURED
    assert result.status[lone] == StrainStatus.FEW_NEIGHBOURS
    assert result.status[side * 18] == StrainStatus.ONE_SIDED
    assert result.status[0] == StrainStatus.FEW_NEIGHBOURS
    assert result.status[middle - 5] == StrainStatus.VALID
    bad = ~valid(result)
    for values in (result.strain, result.principal, result.angle_deg):
        assert np.isnan(values[bad]).all()
        assert np.isfinite(values[~bad]).all()
    at_edge = np.abs(POINTS_PX).max(axis=1) > 90.0 - 0.5 * 40.0 + 1e-9  # half of the half window is beyond the border
    np.testing.assert_array_equal(bad[at_edge & ~corner], True)
    everything_lost = StrainGauge(POINTS_PX, reference).measure(np.full_like(current, np.nan))
    assert np.all(everything_lost.status == StrainStatus.UNMEASURED)


@pytest.mark.parametrize(
    ("step_px", "options", "window_points", "vsg_px"),
    [
        (5.0, {}, 17, 101.0),
        (10.0, {}, 9, 101.0),
        (5.0, {"vsg_mm": 4.0}, 11, 71.0),
        (5.0, {"window_points": 9}, 9, 61.0),
        (5.0, {"subset_px": 31.0}, 15, 101.0),
    ],
)
def test_the_window_and_its_virtual_strain_gauge(step_px, options, window_points, vsg_px):
    points_px, plane_mm = grid(18, step_px)
    window = StrainGauge(points_px, plane_mm, settings=StrainSettings(**options)).window
    assert window.window_points == window_points
    assert window.step_px == pytest.approx(step_px)
    assert window.vsg_px == pytest.approx(vsg_px)
    assert window.vsg_mm == pytest.approx(vsg_px * SCALE_MM)
    if "window_points" not in options:
        assert window.vsg_mm <= StrainSettings(**options).vsg_mm


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"order": 5}, "degrees of strain are 1 to 4"),
        ({"window_points": 8}, "odd"),
        ({"window_points": 3}, "larger than its degree 3"),
        ({"vsg_mm": 0.0}, "must be positive"),
        ({"largest_offset": 0.6}, "largest_offset"),
    ],
)
def test_settings_that_make_no_window_are_refused(options, says):
    with pytest.raises(InputError, match=says):
        StrainSettings(**options)


def test_arrays_that_do_not_match_are_refused():
    with pytest.raises(InputError, match="strain needs points"):
        StrainGauge(POINTS_PX, PLANE_MM[:-1])
    with pytest.raises(InputError, match="at least 4 points; 3 are measured"):
        StrainGauge(POINTS_PX[:3], PLANE_MM[:3])
    with pytest.raises(InputError, match="reference_sigma_mm has shape"):
        StrainGauge(POINTS_PX, PLANE_MM, reference_sigma_mm=np.ones(3))
    with pytest.raises(InputError, match="no room for a strain window at step 5 px"):
        StrainGauge(POINTS_PX, PLANE_MM, settings=StrainSettings(vsg_mm=1.5))
    gauge = StrainGauge(POINTS_PX, PLANE_MM)
    with pytest.raises(InputError, match="points \\(N, 3\\)"):
        gauge.measure(PLANE_MM[:-1])
    with pytest.raises(InputError, match="sigma_mm has shape"):
        gauge.measure(PLANE_MM, np.ones(len(PLANE_MM)))
    with pytest.raises(InputError, match="\\(T, N, 3\\)"):
        surface_strain(POINTS_PX, PLANE_MM, PLANE_MM)
