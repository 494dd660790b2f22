"""The exact trace against what it does not know of: closed forms, Fermat, reversal, the conservation of etendue."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.twin.optics import LOOKING_ALONG_Y, Biprism, CameraOptics
from drivers.twin.options import TwinOptions
from drivers.twin.trace import BLOCKED, DIRECT, LEFT, RIGHT, project, trace_pixels
from drivers.twin.world import World

WORLD = World(TwinOptions())
CAMERA = WORLD.optics("primary")
PRISM = WORLD.prism()
RNG = np.random.default_rng(5)
PIXELS = RNG.uniform([0.0, 0.0], [1279.0, 1023.0], (200, 2))


def aligned(alpha_deg=161.4, index=1.4585):
    camera = CameraOptics(75.0, 0.0067, 1280, 1024, (639.5, 511.5), (0.0,) * 4, (0.0, -622.0, 0.0), LOOKING_ALONG_Y)
    return camera, Biprism(index, alpha_deg, 30.0, 60.0, 50.0, (0.0, -210.0, 0.0), np.eye(3))


@pytest.mark.parametrize("index", [1.3, 1.4585, 1.7])
@pytest.mark.parametrize("alpha_deg", [150.0, 161.4, 175.0])
def test_deviation_in_the_principal_section_is_the_wedges_closed_form(alpha_deg, index):
    camera, prism = aligned(alpha_deg, index)
    columns = np.linspace(650.0, 1270.0, 9)
    rays = trace_pixels(camera, prism, np.stack([columns, np.full(9, 511.5)], axis=-1))
    incidence = np.arctan((columns - 639.5) * 0.0067 / 75.0)
    wedge = math.radians(180.0 - alpha_deg) / 2.0
    # deviation of a wedge, from the angle of incidence alone (Born & Wolf 4.7.2)
    out = np.arcsin(np.sin(wedge) * np.sqrt(index**2 - np.sin(incidence) ** 2) - np.cos(wedge) * np.sin(incidence))
    np.testing.assert_array_equal(rays.side, RIGHT)
    np.testing.assert_allclose(np.arctan2(rays.direction[:, 0], rays.direction[:, 1]), wedge - out, atol=1e-12)


def test_a_plate_shifts_rays_and_turns_none():
    camera, prism = aligned(alpha_deg=180.0)
    pixels = RNG.uniform([0.0, 0.0], [1279.0, 1023.0], (50, 2))
    bent, straight = trace_pixels(camera, prism, pixels), trace_pixels(camera, None, pixels)
    np.testing.assert_allclose(bent.direction, straight.direction, atol=1e-14)
    at_edge = straight.origin_mm + straight.direction * (412.0 / straight.direction[:, 1:2])
    shift = np.linalg.norm(np.cross(bent.origin_mm - at_edge, bent.direction), axis=1)
    angle = np.arccos(straight.direction[:, 1])
    inside = np.arcsin(np.sin(angle) / 1.4585)
    np.testing.assert_allclose(shift, 30.0 * np.sin(angle - inside) / np.cos(inside), atol=1e-12)


def _snell(direction, normal, before, after):
    """Snell's law by the tangential component, which the face does not change (not the kernel's form)."""
    normal = normal * np.sign(direction @ normal)
    tangential = (direction - (direction @ normal) * normal) * before / after
    return tangential + normal * math.sqrt(1.0 - tangential @ tangential)


def test_a_ray_sent_back_returns_to_the_lens():
    rays = trace_pixels(CAMERA, PRISM, PIXELS)
    beta, n = PRISM.base_angle_rad, PRISM.refractive_index
    edge, axes = np.asarray(PRISM.edge_mm), PRISM.rotation
    for origin, direction, side in zip(rays.origin_mm, rays.direction, rays.side, strict=True):
        normal = axes.T @ np.array([side * math.sin(beta), math.cos(beta), 0.0])
        assert abs((origin - edge) @ normal) < 1e-10
        inner = _snell(-direction, normal, 1.0, n)
        back = edge - axes[1] * PRISM.thickness_mm
        place = origin + inner * (((back - origin) @ axes[1]) / (inner @ axes[1]))
        outer = _snell(inner, axes[1], n, 1.0)
        to_lens = np.asarray(CAMERA.position_mm) - place
        assert np.linalg.norm(np.cross(to_lens, outer)) < 1e-9
        assert to_lens @ outer > 0.0


def test_the_optical_path_is_stationary():
    """Fermat: no neighbouring path from lens to object is shorter to first order."""
    rays = trace_pixels(CAMERA, PRISM, PIXELS[:40])
    beta, n, axes = PRISM.base_angle_rad, PRISM.refractive_index, PRISM.rotation
    back = np.asarray(PRISM.edge_mm) - axes[1] * PRISM.thickness_mm
    lens = np.asarray(CAMERA.position_mm)
    for origin, direction, side in zip(rays.origin_mm, rays.direction, rays.side, strict=True):
        target = origin + 210.0 * direction
        normal = axes.T @ np.array([side * math.sin(beta), math.cos(beta), 0.0])
        inner = _snell(-direction, normal, 1.0, n)
        entry = origin + inner * (((back - origin) @ axes[1]) / (inner @ axes[1]))
        slope = axes.T @ np.array([math.cos(beta), -side * math.sin(beta), 0.0])

        def path(shift, entry=entry, origin=origin, target=target, slope=slope):
            p = entry + shift[0] * axes[0] + shift[1] * axes[2]
            q = origin + shift[2] * slope + shift[3] * axes[2]
            return np.linalg.norm(p - lens) + n * np.linalg.norm(q - p) + np.linalg.norm(target - q)

        for i in range(4):
            step = np.zeros(4)
            step[i] = 1e-3
            assert abs(path(step) - path(-step)) / 2e-3 < 1e-9


def test_etendue_is_conserved():
    """Liouville: the map of (place, direction cosine) through the prism is symplectic, so radiance is kept."""
    base = np.array([0.0, 0.0, 400.0, 300.0])

    def ray(v):
        camera = replace(CAMERA, position_mm=(v[0], -622.0, v[1]))
        before = trace_pixels(camera, None, v[None, 2:])
        after = trace_pixels(camera, PRISM, v[None, 2:])
        landing = after.origin_mm - after.direction * after.origin_mm[:, 1:2] / after.direction[:, 1:2]
        pick = [0, 2]
        return (
            np.concatenate([before.origin_mm[0, pick], before.direction[0, pick]]),
            np.concatenate([landing[0, pick], after.direction[0, pick]]),
        )

    steps = np.diag([0.01, 0.01, 0.1, 0.1])
    pairs = [(ray(base + s), ray(base - s)) for s in steps]
    into = np.stack([a[0] - b[0] for a, b in pairs], axis=-1)
    out = np.stack([a[1] - b[1] for a, b in pairs], axis=-1)
    through = out @ np.linalg.inv(into)
    j = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    np.testing.assert_allclose(through.T @ j @ through, j, atol=1e-6 * np.abs(through).max())
    assert np.linalg.det(through) == pytest.approx(1.0, abs=1e-6)


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(st.floats(-14.0, 14.0), st.floats(-20.0, 25.0), st.floats(-24.0, 24.0)),
    st.sampled_from([LEFT, RIGHT, DIRECT]),
)
def test_projection_inverts_the_trace_to_a_millionth_of_a_pixel(point, side):
    prism = PRISM if side else None
    pixel = project(CAMERA, prism, np.array([point]), side)
    rays = trace_pixels(CAMERA, prism, pixel)
    assert rays.side[0] == side
    miss_mm = np.linalg.norm(np.cross(np.array(point) - rays.origin_mm, rays.direction))
    assert miss_mm < 1e-6 * 0.05  # a pixel is about 0.055 mm there


def test_projection_without_prism_is_browns_model():
    camera = replace(CAMERA, distortion=(-0.5, 3.0, 0.002, -0.003))
    points = RNG.uniform(-20.0, 20.0, (100, 3))
    x, y = ((project(camera, None, points) - camera.principal_px) * 0.0067 / 75.0).T
    r2 = x**2 + y**2
    radial = 1.0 - 0.5 * r2 + 3.0 * r2**2
    ideal_x = x * radial + 2 * 0.002 * x * y - 0.003 * (r2 + 2 * x**2)
    ideal_y = y * radial + 0.002 * (r2 + 2 * y**2) - 2 * 0.003 * x * y
    depth = points[:, 1] + 622.0
    np.testing.assert_allclose(ideal_x, points[:, 0] / depth, atol=1e-13)
    np.testing.assert_allclose(ideal_y, -points[:, 2] / depth, atol=1e-13)


def test_projection_says_nan_where_no_ray_goes():
    far_left, behind_flank = [[-60.0, 0.0, 0.0]], [[0.0, 0.0, 200.0]]
    assert np.isnan(project(CAMERA, PRISM, np.array(far_left), RIGHT)).all()
    assert np.isnan(project(CAMERA, PRISM, np.array(behind_flank), RIGHT)).all()
    assert np.isnan(project(CAMERA, PRISM, np.array([[0.0, 0.0, 0.0]]), DIRECT)).all()


def test_a_half_lowered_prism_shows_its_top_edge():
    state = WORLD.state()._replace(jack_mm=45.0)
    rows = np.arange(1024.0)
    side = WORLD.rays("primary", np.stack([np.full(1024, 300.0), rows], axis=-1), state).side
    assert side[0] == DIRECT
    assert side[-1] == LEFT
    changes = side[np.concatenate([[True], np.diff(side) != 0])]
    np.testing.assert_array_equal(changes, [DIRECT, BLOCKED, LEFT])
    # the top of the back face, 25 mm above the prism's middle, is where the direct view ends (tilts are small)
    top_z = 25.0 + 45.0 - 70.0
    expected_row = 511.5 - top_z / 382.0 * 75.0 / 0.0067
    assert abs(np.argmax(side != DIRECT) - expected_row) < 60.0


def test_the_prism_is_out_of_view_when_lowered_and_never_in_the_auxiliary_view():
    low = WORLD.state()._replace(jack_mm=5.0)
    assert WORLD.sides("primary") == (-1, 1)
    assert WORLD.sides("primary", low) == (0,)
    assert WORLD.sides("auxiliary") == (0,)
    assert WORLD.sides("primary", WORLD.state()._replace(jack_mm=45.0)) == (-1, 0, 1)
