"""Speckled bodies: the pattern, where rays meet them, and that their images move as their points do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares

from drivers.twin.options import SpeckleOptions, TwinOptions
from drivers.twin.speckle import PERIOD, speckle_at, speckle_coefficients
from drivers.twin.world import World
from tests.drivers.twin.rigs import EVEN, coarse_options

FULL = World(TwinOptions.model_validate({"light": EVEN, "sensor": {"blur_px": 0.0}}))


def _pixels(world, side, count=400, seed=2):
    optics = world.optics("primary")
    low = 0.5 * optics.width_px if side > 0 else 0.0
    pixels = np.random.default_rng(seed).uniform(
        [low, 0.0], [low + 0.5 * optics.width_px, optics.height_px], (count, 2)
    )
    return pixels


def test_the_pattern_is_a_bicubic_b_spline_of_its_coefficients():
    speckle = SpeckleOptions(spacing_mm=0.2, seed=3)
    c = speckle_coefficients(speckle)
    basis = BSpline(np.arange(8.0) - 3.0, np.eye(4), 3)  # on 0..1, uniform knots
    for u, v in np.random.default_rng(0).uniform(0.0, 100.0, (50, 2)):
        i, j = int(u // 0.2) % PERIOD, int(v // 0.2) % PERIOD
        expected = basis(v / 0.2 % 1.0) @ c[j : j + 4, i : i + 4] @ basis(u / 0.2 % 1.0)
        assert speckle_at(u, v, c, 0.2) == pytest.approx(expected, abs=1e-12)
    assert speckle_at(-0.01, 3.0, c, 0.2) == pytest.approx(speckle_at(-0.01 + PERIOD * 0.2, 3.0, c, 0.2))


def test_a_speckle_is_four_to_five_pixels_wide():
    world = FULL
    world.place("membrane")
    state = world.state()._replace(jack_mm=5.0)
    patch = world.irradiance("primary", state)[400:600, 540:740].astype(float)
    patch -= patch.mean()
    spectrum = np.abs(np.fft.fft2(patch)) ** 2
    correlation = np.fft.ifft2(spectrum).real
    line = (correlation[0, :10] + correlation[:10, 0]) / (2.0 * correlation[0, 0])
    below = int(np.argmax(line < 0.5))
    half = below - (0.5 - line[below]) / (line[below - 1] - line[below])
    assert 4.0 < 2.0 * half < 5.2


@pytest.mark.parametrize("side", [-1, 1])
def test_rays_meet_the_sphere_on_its_surface(side):
    world = World(coarse_options())
    world.place("sphere")
    pixels = _pixels(world, side)
    seen = world.surface("primary", pixels)
    hit = seen.speckled
    assert 50 < hit.sum() < 350
    centre = world.object_pose().origin_mm
    np.testing.assert_allclose(np.linalg.norm(seen.xyz_mm[hit] - centre, axis=1), 18.265, atol=1e-10)
    np.testing.assert_allclose(world.surface_positions(seen.material_mm[hit]), seen.xyz_mm[hit], atol=1e-9)
    # it is the near side: the projection of the point is the pixel again, and its normal faces the ray
    np.testing.assert_allclose(world.project("primary", seen.xyz_mm[hit], side), pixels[hit], atol=1e-6)
    direction = world.rays("primary", pixels[hit]).direction
    assert np.all(np.einsum("ni,ni->n", seen.xyz_mm[hit] - centre, direction) < 0.0)
    rays = world.rays("primary", pixels[~hit])
    offset = centre - rays.origin_mm
    miss = np.linalg.norm(np.cross(offset, rays.direction), axis=1)
    assert np.all(miss > 18.265)


@pytest.mark.parametrize("pressure_kpa", [0.0, 0.05, 13.0, 16.0])
@pytest.mark.parametrize("camera", ["primary", "auxiliary"])
def test_rays_meet_the_membrane_where_its_material_is(camera, pressure_kpa):
    world = World(coarse_options())
    world.place("membrane", turn_deg=(0.0, 0.0, 8.0))
    state = world.state()._replace(pressure_kpa=pressure_kpa)
    pixels = np.concatenate([_pixels(world, -1, 800), _pixels(world, 1, 800)])
    seen = world.surface(camera, pixels, state)
    hit = seen.speckled
    assert hit.sum() > 150
    np.testing.assert_allclose(world.surface_positions(seen.material_mm[hit], state), seen.xyz_mm[hit], atol=2e-6)
    for side in world.sides(camera, state):
        own = hit & (world.rays(camera, pixels, state).side == side)
        np.testing.assert_allclose(world.project(camera, seen.xyz_mm[own], side, state), pixels[own], atol=1e-6)


def test_the_membrane_has_no_holes():
    """Every ray that passes inside the window's rim meets the membrane: a convex cap over the rim's disc."""
    world = World(coarse_options())
    world.place("membrane", turn_deg=(5.0, 0.0, 10.0))
    state = world.state()._replace(pressure_kpa=16.0)
    pose = world.object_pose(state).inverse()
    columns, rows = np.meshgrid(np.arange(320.0), np.arange(256.0))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    rays = world.rays("primary", pixels, state)
    origin, direction = pose.apply(rays.origin_mm), rays.direction @ pose.rotation.T
    flat = origin - direction * (origin[:, 2:] / direction[:, 2:])
    inside = np.hypot(flat[:, 0], flat[:, 1]) < 14.999
    seen = world.surface("primary", pixels, state)
    assert inside.sum() > 5000
    assert seen.speckled[inside].all()


def _displacement(reference, current, centre, guess, half=12):
    """Image displacement of a square of the reference by least squares on quintic interpolation (affine)."""
    span = np.arange(-half, half + 1.0)
    x, y = np.meshgrid(span, span)
    template = map_coordinates(reference, [centre[1] + y, centre[0] + x], order=5)

    def residual(p):
        columns = centre[0] + x + p[0] + p[2] * x + p[3] * y
        rows = centre[1] + y + p[1] + p[4] * x + p[5] * y
        sampled = map_coordinates(current, [rows, columns], order=5)
        return (p[6] * sampled + p[7] - template).ravel()

    start = np.array([*guess, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    return least_squares(residual, start, x_scale=[1, 1, 0.05, 0.05, 0.05, 0.05, 1, 1]).x[:2]


@pytest.mark.parametrize(("scene", "pressure_kpa"), [("sphere", 0.05), ("membrane", 0.05), ("membrane", 0.5)])
def test_speckles_move_in_the_image_as_their_material_does(scene, pressure_kpa):
    world = FULL
    world.place(scene)
    before = world.state()
    after = before
    if pressure_kpa == 0.05:
        world.place(scene, shift_mm=(0.131, -0.2, 0.077))
        after = world.state()
    after = after._replace(pressure_kpa=pressure_kpa)
    first, second = (world.irradiance("primary", s).astype(float) for s in (before, after))
    for centre, side in (((340.0, 480.0), -1), ((930.0, 560.0), 1)):
        material = world.surface("primary", np.array([centre]), before).material_mm
        truth = world.project("primary", world.surface_positions(material, after), side, after)[0] - centre
        assert np.hypot(*truth) > 0.4
        found = _displacement(first, second, centre, np.round(truth))
        np.testing.assert_allclose(found, truth, atol=0.01)


@pytest.mark.parametrize("scene", ["sphere", "membrane"])
def test_two_gauss_points_per_axis_do_for_a_pixels_mean(scene):
    images = {}
    for samples in (2, 3):
        speckle = {"spacing_mm": 0.52, "samples": samples}
        world = World(coarse_options(sphere={"speckle": speckle}, membrane={"speckle": speckle}))
        world.place(scene)
        images[samples] = world.irradiance("primary")
    inner = np.s_[100:150, 50:110]
    assert np.abs(images[2][inner] - images[3][inner]).max() < 2e-3
    assert images[2][inner].std() > 0.05


def test_surface_truth_needs_a_speckled_body():
    world = World(coarse_options())
    with pytest.raises(ValueError, match="place a sphere or the membrane"):
        world.surface("primary", np.zeros((1, 2)))
    with pytest.raises(ValueError, match="place a sphere or the membrane"):
        world.surface_positions(np.zeros((1, 2)))
