"""The cube: where its dots are, what is visible, and its image against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.twin.coverage import disc_share
from drivers.twin.options import TwinOptions
from drivers.twin.world import World
from tests.drivers.twin.rigs import EVEN, coarse_options

WORLD = World(TwinOptions.model_validate({"light": EVEN, "sensor": {"blur_px": 0.0}}))


def test_corner_pose_dots_define_the_world_frame():
    view = WORLD.dots("primary")[0]
    face, rest = np.divmod(view.index, 207)
    row, column = np.divmod(rest, 9)
    along = (2.0 + 2.0 * column) / math.sqrt(2.0)
    expected = np.stack([np.where(face == 0, along, -along), along, 22.0 - 2.0 * row], axis=-1)
    np.testing.assert_allclose(view.xyz_mm, expected, atol=1e-12)


def test_stages_turn_and_travel_about_their_own_axes():
    corner = WORLD.state()
    start = WORLD.object_pose(corner)
    turned = WORLD.object_pose(corner._replace(rotation_deg=15.0))
    motion = turned.rotation @ start.rotation.T
    axis = np.array([math.tan(math.radians(0.15)), math.tan(math.radians(-0.1)), 1.0])
    axis /= np.linalg.norm(axis)
    np.testing.assert_allclose(motion @ axis, axis, atol=1e-14)
    assert np.trace(motion) == pytest.approx(1.0 + 2.0 * math.cos(math.radians(30.0)), abs=1e-13)
    # a body turned clockwise from above: what pointed away now points to the right
    assert (motion @ [0.0, 1.0, 0.0])[0] > 0.49
    pivot = np.array([0.6, 13.5, 0.0]) + 7.0 * axis
    body = (pivot - start.origin_mm) @ start.rotation
    np.testing.assert_allclose(turned.apply(body[None])[0], pivot, atol=1e-12)
    travelled = WORLD.object_pose(corner._replace(translation_mm=60.0)).origin_mm - start.origin_mm
    assert np.linalg.norm(travelled) == pytest.approx(10.0, abs=1e-12)
    assert travelled[0] / travelled[1] == pytest.approx(math.tan(math.radians(0.2)))
    assert travelled[2] / travelled[1] == pytest.approx(math.tan(math.radians(-0.15)))


def test_face_pose_is_parallel_to_the_sensor_up_to_the_axis_tilt():
    normal = WORLD.object_pose(WORLD.state()._replace(rotation_deg=0.0)).rotation @ [0.0, -1.0, 0.0]
    assert math.degrees(math.acos(-normal[1])) < 0.3


@pytest.mark.parametrize(
    ("rotation_deg", "jack_mm", "camera", "visible"),
    [
        (45.0, 70.0, "primary", {-1: 414, 1: 414}),
        (45.0, 5.0, "primary", {0: 414}),
        (0.0, 70.0, "primary", {-1: 207, 1: 207}),
        (0.0, 70.0, "auxiliary", {0: 207}),
    ],
)
def test_which_dots_are_visible(rotation_deg, jack_mm, camera, visible):
    state = WORLD.state()._replace(rotation_deg=rotation_deg, jack_mm=jack_mm)
    views = WORLD.dots(camera, state)
    assert {view.side: int(view.visible.sum()) for view in views} == visible
    if rotation_deg == 0.0:
        assert all(view.visible[:207].all() for view in views)


def test_dots_that_the_split_or_the_border_cuts_are_not_visible():
    world = World(TwinOptions())
    world.place("cube", shift_mm=(9.0, 0.0, 0.0))
    for view in world.dots("primary"):
        split = 639.5
        seen = view.xy_px[view.visible]
        radius = 8.0  # a dot is 18 px wide, 13 px across in the corner pose
        assert np.all(seen > 1.5 + 5.0)
        assert np.all(seen[:, 0] < 1278.0 - 5.0)
        assert (seen[:, 0] < split).all() if view.side < 0 else (seen[:, 0] > split).all()
        hidden = view.xy_px[~view.visible & np.isfinite(view.xy_px).all(axis=1)]
        inside = (hidden[:, 0] > 25.0) & (hidden[:, 0] < 1255.0) & (np.abs(hidden[:, 0] - split) > 3 * radius)
        assert not inside.any()
    assert 0 < sum(int(view.visible.sum()) for view in world.dots("primary")) < 828


def _brute_force(state, columns, rows):
    """Mean of 2584 exactly traced points a pixel on the right face, met as a plane (numpy only)."""
    pose = WORLD.object_pose(state)
    k = np.arange(2584)
    spread = np.stack([(k + 0.5) / 2584 - 0.5, (k * 1597 % 2584 + 0.5) / 2584 - 0.5], axis=-1)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)[:, :, None] + spread
    rays = WORLD.rays("primary", pixels.reshape(-1, 2), state)
    origin = (rays.origin_mm - pose.origin_mm) @ pose.rotation
    direction = rays.direction @ pose.rotation
    place = origin - direction * (origin[:, 1:2] / direction[:, 1:2])
    u, v = (place[:, 0] - 2.0) / 2.0, (place[:, 2] + 22.0) / 2.0
    radius = 2.0 * np.hypot(u - np.round(u), v - np.round(v))
    bright = 0.7 * np.where(radius <= 0.5, 0.08, 1.0)
    return bright.reshape(len(rows), len(columns), 2584).mean(axis=2)


def _contour_centroid(state, label, side):
    """Centroid of a dot's image from the exact images of 720 points of its rim (right face), by Green's theorem."""
    row, column = divmod(label, 9)
    turn = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
    along, up = 2.0 + 2.0 * column + 0.5 * np.cos(turn), 22.0 - 2.0 * row + 0.5 * np.sin(turn)
    rim = WORLD.object_pose(state).apply(np.stack([along, np.zeros(720), up], axis=-1))
    a = WORLD.project("primary", rim, side, state)
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    return ((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())


@pytest.mark.parametrize(("rotation_deg", "side"), [(45.0, -1), (45.0, 1), (0.0, 1)])
def test_rendered_dots_match_brute_force(rotation_deg, side):
    """Coverage by area on traced pixel corners against 2584 fully traced rays a pixel."""
    state = WORLD.state()._replace(rotation_deg=rotation_deg)
    image = WORLD.irradiance("primary", state)
    view = next(v for v in WORLD.dots("primary", state) if v.side == side)
    for label in (0, 206):
        centre = np.round(view.xy_px[label]).astype(int)
        columns, rows = centre[0] + np.arange(-16, 17), centre[1] + np.arange(-16, 17)
        patch = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(float)
        expected = _brute_force(state, columns.astype(float), rows.astype(float))
        # 2584 points leave a quarter of a percent of the contrast at a hard edge
        np.testing.assert_allclose(patch, expected, atol=0.003)
        weight, truth = 0.7 - patch, 0.7 - expected
        grids = np.meshgrid(columns, rows)
        for grid, exact in zip(grids, view.xy_px[label], strict=True):
            centroid = (weight * grid).sum() / weight.sum()
            assert abs(centroid - (truth * grid).sum() / truth.sum()) < 5e-4
            # a circle's image is not centred on the image of its centre, but nearly so
            assert abs(centroid - exact) < 0.02
        contour = _contour_centroid(state, label, side)
        assert np.hypot(*(contour - [(weight * grid).sum() / weight.sum() for grid in grids])) < 3e-3


def test_outline_and_split_pixels_hold_the_share_that_is_seen():
    """Over all pixels the image's mean equals that of many traced points spread over the sensor."""
    world = World(coarse_options())
    image = world.irradiance("primary")
    fine = World(coarse_options(factor=1))
    reference = fine.irradiance("primary").reshape(256, 4, 320, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(image, reference, atol=0.01)
    assert abs(float(image.mean()) - float(reference.mean())) < 5e-5


def test_the_light_is_lamberts():
    options = TwinOptions.model_validate({"light": {"vignetting": 0.0}, "sensor": {"blur_px": 0.0}})
    world = World(options)
    state = world.state()._replace(rotation_deg=0.0, jack_mm=5.0)
    u, v = 9.0, 1.0  # bare paper of the right face
    pose = world.object_pose(state)
    place = pose.apply(np.array([[u, 0.0, v]]))
    pixel = np.round(world.project("primary", place, 0, state)[0]).astype(int)
    normal = pose.rotation @ [0.0, -1.0, 0.0]
    up = math.radians(15.0)
    lamps = [
        np.array([math.sin(a) * math.cos(up), -math.cos(a) * math.cos(up), math.sin(up)])
        for a in np.radians([-45.0, 45.0])
    ]
    facing = sum(-lamp[1] for lamp in lamps)
    lit = 0.4 + 0.6 * sum(max(0.0, lamp @ normal) for lamp in lamps) / facing
    gradient = 1.0 + 0.002 * place[0, 0] + 0.001 * place[0, 2]
    assert world.irradiance("primary", state)[pixel[1], pixel[0]] == pytest.approx(0.7 * lit * gradient, rel=2e-4)


def test_disc_share_of_a_quadrilateral_that_holds_the_disc():
    us, vs = (-2.0, 3.0, 4.0, -1.5), (-2.0, -2.5, 3.0, 2.0)
    area = 0.5 * abs(sum(us[i] * vs[(i + 1) % 4] - us[(i + 1) % 4] * vs[i] for i in range(4)))
    assert disc_share(us, vs, 0.2, 0.1, 1.0) == pytest.approx(math.pi / area, rel=1e-12)


def test_disc_share_of_a_half_and_a_quarter():
    square = ((0.0, 2.0, 2.0, 0.0), (0.0, 0.0, 2.0, 2.0))
    assert disc_share(*square, 0.0, 1.0, 1.0) == pytest.approx(math.pi / 8.0, rel=1e-12)
    assert disc_share(*square, 0.0, 0.0, 1.0) == pytest.approx(math.pi / 16.0, rel=1e-12)
    assert disc_share(*square, 5.0, 5.0, 1.0) == 0.0
    assert disc_share(*square, 1.0, 1.0, 3.0) == 1.0


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-0.3, 0.3), min_size=8, max_size=8), st.floats(0.2, 3.0), st.floats(0.0, 6.3))
def test_disc_share_matches_a_fine_grid(jitter, radius, turn):
    us = np.array([0.0, 1.0, 1.0, 0.0]) + jitter[:4]
    vs = np.array([0.0, 0.0, 1.0, 1.0]) + jitter[4:]
    cu, cv = 0.5 + radius * math.cos(turn), 0.5 + radius * math.sin(turn)
    share = disc_share(tuple(us), tuple(vs), cu, cv, radius)
    x, y = np.meshgrid(np.linspace(-0.4, 1.4, 500), np.linspace(-0.4, 1.4, 500))
    inside = np.ones(x.shape, bool)
    for i in range(4):
        k = (i + 1) % 4
        inside &= (us[k] - us[i]) * (y - vs[i]) - (vs[k] - vs[i]) * (x - us[i]) >= 0.0
    covered = (x - cu) ** 2 + (y - cv) ** 2 <= radius**2
    assert share == pytest.approx((inside & covered).sum() / inside.sum(), abs=0.02)
