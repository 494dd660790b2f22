"""The shift between a projected circle's centre and the projection of its centre, against exact projections."""

import numpy as np
import pytest

from bscd.calibration.dots.face_map import fit_face_map
from bscd.calibration.target import GridTarget
from drivers.twin.trace import project
from tests.calibration.dots.twin_views import CORNER_DEG, FACE_DEG, LOWERED, RAISED, polygon_centroid, side_of, twin

RIM = 180


def face_in_view(world, camera, side, face, radius_mm):
    """Lattice ``(N, 2)``, images of the centres and of the rims' centroids ``(N, 2)`` of one face."""
    target = GridTarget()
    index = np.arange(target.dots_per_face) + face * target.dots_per_face
    _, row, column = target.face_row_column(index)
    points = target.points_mm(index)
    along, up = points[1] - points[0], np.array([0.0, 0.0, 1.0])
    along = along / np.linalg.norm(along)
    turn = np.linspace(0, 2 * np.pi, RIM, endpoint=False)
    rim = points[:, None] + radius_mm * (np.cos(turn)[:, None] * along + np.sin(turn)[:, None] * up)
    pose = world.object_pose()
    # the cube's own frame has its middle at the origin: the same rigid map as from its dots at rest to now
    rest = twin().object_pose()
    moved = pose.after(rest.inverse())
    optics, prism = world.optics(camera), world.prism() if side else None
    centres = project(optics, prism, moved.apply(points), side)
    rims = project(optics, prism, moved.apply(rim.reshape(-1, 3)), side).reshape(len(points), RIM, 2)
    whole = np.isfinite(rims).all(axis=(1, 2))
    return np.stack([column, row], axis=-1)[whole], centres[whole], polygon_centroid(rims[whole])


@pytest.mark.parametrize(
    ("camera", "rotation_deg", "view", "face"),
    [
        ("primary", CORNER_DEG, "past", 0),
        ("primary", FACE_DEG, "past", 0),
        ("auxiliary", CORNER_DEG, "past", 0),
        ("auxiliary", CORNER_DEG, "past", 1),
        ("primary", CORNER_DEG, "left", 0),
        ("primary", CORNER_DEG, "right", 1),
        ("primary", FACE_DEG, "right", 0),
    ],
)
@pytest.mark.parametrize("radius_mm", [0.5, 0.9])
def test_shift_equals_that_of_exact_rims(camera, rotation_deg, view, face, radius_mm):
    world = twin(rotation_deg, jack_mm=LOWERED if view == "past" else RAISED)
    side = 0 if view == "past" else side_of(world, view)
    lattice, centres, centroids = face_in_view(world, camera, side, face, radius_mm)
    shift = fit_face_map(lattice, centroids).centre_shift(lattice, radius_mm / 2.0)
    exact = centroids - centres
    assert np.abs(shift - exact).max() < 0.0005 * (radius_mm / 0.5) ** 2
    if rotation_deg == CORNER_DEG:
        assert np.abs(exact).max() > 0.002  # there is something to correct


def test_the_map_predicts_dots_that_it_has_not_seen():
    world = twin()
    lattice, centres, _ = face_in_view(world, "primary", 0, 0, 0.5)
    known = (lattice[:, 0] > 0) & (lattice[:, 1] < 22)
    face_map = fit_face_map(lattice[known], centres[known])
    assert np.abs(face_map.pixels(lattice[~known]) - centres[~known]).max() < 0.02
    step = 1e-4
    slope = (face_map.pixels(lattice + np.array([step, 0])) - face_map.pixels(lattice - np.array([step, 0]))) / (
        2 * step
    )
    assert np.allclose(face_map.jacobian(lattice)[..., 0], slope, atol=1e-6)


def test_outliers_do_not_bend_it():
    world = twin()
    lattice, centres, _ = face_in_view(world, "primary", 0, 0, 0.5)
    noisy = centres + np.random.default_rng(0).normal(0, 0.01, centres.shape)
    noisy[[5, 60, 111]] += [8.0, -5.0]
    assert np.abs(fit_face_map(lattice, noisy).pixels(lattice) - centres).max() < 0.02
