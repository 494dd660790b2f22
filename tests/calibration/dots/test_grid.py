"""The dots of the twin's cube against the twin's truth: precision, completeness, labels."""

import numpy as np
import pytest

from bscd.calibration.dots import Seed, SplitLine, SplitRegion, find_grid, find_split
from bscd.calibration.target import GridTarget
from bscd.errors import CheckFailedError, InputError
from tests.calibration.dots.twin_cases import run_case
from tests.calibration.dots.twin_views import (
    CORNER_DEG,
    FACE_DEG,
    RAISED,
    errors,
    expose,
    side_of,
    target_of,
    true_split,
    truth,
    twin,
)


def check_cases(seeds):
    """The requirement: every visible dot, none wrong, mean and standard deviation of the errors per axis."""
    results = [r for seed in seeds for r in run_case(seed)]
    assert {r.name: r.missed for r in results if r.missed} == {}
    assert {r.name: r.wrong for r in results if r.wrong} == {}
    error = np.concatenate([r.error_px for r in results])
    sigma = np.concatenate([r.sigma_px for r in results])
    assert np.abs(error.mean(axis=0)).max() <= 0.005
    assert error.std(axis=0).max() <= 0.010
    assert np.abs(error).max() < 0.15
    assert (error / sigma[:, None]).std() == pytest.approx(1.0, abs=0.15)
    # also what the twin does not count as visible (within 2 px of a border) has to be right where it is given
    beyond = np.concatenate([r.beyond_px for r in results])
    assert len(beyond) == 0 or beyond.max() < 0.1


def test_random_poses_and_lightings():
    check_cases(range(6))


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_200_random_poses_and_lightings():
    check_cases(range(200))


@pytest.mark.parametrize(
    ("camera", "rotation_deg", "pose"), [("auxiliary", FACE_DEG, "face"), ("primary", 45.0, "corner")]
)
def test_other_grids_and_deeper_images(camera, rotation_deg, pose):
    """Nothing may rely on the default target, on 8 bits, or on the grey levels' scale."""
    cube = {"columns": 7, "rows": 15, "pitch_mm": 2.4, "dot_diameter_mm": 1.5, "margin_mm": 1.5}
    world = twin(rotation_deg, bits=12, cube=cube)
    image = expose(world, camera)
    assert image.dtype == np.uint16
    dots = truth(world, camera)
    for version in (image, image.astype(np.float64) / 4095.0):
        finding = find_grid(version, target_of(world), pose)
        assert set(dots.index[dots.visible]) <= set(finding.index)
        assert np.abs(errors(finding, dots)).max() < 0.1


def test_two_faces_with_columns_at_the_pitch_across_the_edge():
    """With margin = pitch / 2 the columns go on across the edge: only the geometry tells where it is."""
    world = twin(cube={"margin_mm": 1.0})
    finding = find_grid(expose(world), target_of(world), "corner")
    dots = truth(world)
    assert set(dots.index[dots.visible]) == set(finding.index)
    assert np.abs(errors(finding, dots)).max() < 0.1


def test_the_squeezed_face_is_never_the_scanned_one():
    """Turned until the second face shows at a grazing angle beside the scanned one."""
    for turn_deg in (4.0, 8.0, 14.0):
        world = twin(FACE_DEG + turn_deg)
        finding = find_grid(expose(world), GridTarget(), "face")
        dots = truth(world)
        assert np.abs(errors(finding, dots)).max() < 0.1
        assert set(np.flatnonzero(dots.visible[: GridTarget().dots_per_face])) <= set(finding.index)


def test_dots_cut_by_the_split_line_are_named():
    world = twin(jack_mm=RAISED, shift_mm=(5.0, 0.0, 0.0))
    image, line = expose(world), true_split(world)
    for half in ("left", "right"):
        finding = find_grid(image, GridTarget(), "corner", region=SplitRegion(line, half))
        dots = truth(world, side=side_of(world, half))
        visible = set(dots.index[dots.visible])
        missing = {m.index: m.reason for m in finding.missing}
        assert visible <= set(finding.index)
        assert not set(missing) & set(finding.index)
        assert len(missing) + len(finding.index) == 2 * GridTarget().dots_per_face
        assert np.abs(errors(finding, dots)).max() < 0.1
        cut = [m for m in finding.missing if m.reason == "cut by the split line"]
        for m in cut:
            assert abs(m.xy_px[0] - line.column_at(m.xy_px[1])) < 12.0
        if half == side_half_that_is_cut(world, line):
            assert len(cut) >= 10
            assert any("beyond" in reason for reason in missing.values())


@pytest.mark.parametrize("rotation_deg", [CORNER_DEG, FACE_DEG])
def test_a_bright_background_beyond_the_cut_holds_no_dots(rotation_deg):
    """Cut by a line that is not known: nothing may be found on what is as bright as the face beside it."""
    pose = "corner" if rotation_deg == CORNER_DEG else "face"
    light = {"background": 0.55, "level": 0.6}
    world = twin(rotation_deg, jack_mm=RAISED, shift_mm=(7.0 if pose == "corner" else 9.7, 0.0, 0.0), light=light)
    dots, line = truth(world, side=side_of(world, "left")), true_split(world)
    unknown = SplitLine(line.column_px + 40.0, line.tilt, False, 20.0, line.middle_row_px)
    finding = find_grid(expose(world), GridTarget(), pose, region=SplitRegion(unknown, "left"))
    assert set(np.flatnonzero(dots.visible[: None if pose == "corner" else 207])) <= set(finding.index)
    assert (dots.xy_px[finding.index, 0] < line.column_at(dots.xy_px[finding.index, 1])).all()
    assert np.abs(errors(finding, dots)).max() < 0.5
    assert any(m.reason for m in finding.missing)


def side_half_that_is_cut(world, line):
    """The half whose truth has dots on the wrong side of the line."""
    for half, sign in (("left", 1), ("right", -1)):
        dots = truth(world, side=side_of(world, half))
        if (sign * (dots.xy_px[:, 0] - line.column_at(dots.xy_px[:, 1])) > -5).any():
            return half
    return None


def test_a_covered_and_a_dirty_dot_are_missing_with_a_reason():
    world = twin(FACE_DEG)
    image = expose(world).copy()
    dots = truth(world)
    covered, dirty = 40, 100
    (x, y), (u, v) = np.rint(dots.xy_px[covered]).astype(int), np.rint(dots.xy_px[dirty]).astype(int)
    image[y - 14 : y + 15, x - 14 : x + 15] = 170
    image[v - 4 : v + 14, u + 2 : u + 5] = 175
    finding = find_grid(image, GridTarget(), "face")
    reasons = {m.index: m.reason for m in finding.missing}
    assert set(reasons) == {covered, dirty}
    assert reasons[dirty].startswith("not a clean dot")
    assert np.abs(errors(finding, dots)).max() < 0.1


def test_saturation_and_weak_contrast_are_told():
    bright = twin(FACE_DEG, light={"level": 0.9, "gradient_per_mm": (0.01, 0.0, 0.0)})
    finding = find_grid(expose(bright, brightness=1.3), GridTarget(), "face")
    assert finding.saturated_fraction > 0.05
    assert any("saturated" in w for w in finding.warnings)
    dim = find_grid(expose(bright, brightness=0.07), GridTarget(), "face")
    assert any("contrast" in w for w in dim.warnings)
    assert dim.saturated_fraction == 0.0


@pytest.mark.parametrize(("columns", "rows"), [(8, 23), (9, 20), (10, 23), (9, 25)])
@pytest.mark.parametrize(("rotation_deg", "pose"), [(CORNER_DEG, "corner"), (FACE_DEG, "face")])
def test_another_grid_than_the_target_says(columns, rows, rotation_deg, pose):
    world = twin(rotation_deg, cube={"columns": columns, "rows": rows})
    with pytest.raises(CheckFailedError, match=rf"{columns} columns x {rows} rows.*9 x 23"):
        find_grid(expose(world), GridTarget(), pose)


def test_no_grid_in_the_image():
    noise = np.random.default_rng(0).normal(100, 3, (400, 500))
    with pytest.raises(CheckFailedError, match="no dot grid"):
        find_grid(noise.astype(np.uint8), GridTarget(), "face")


def test_poses_that_are_not_what_they_should_be():
    corner, face = twin(CORNER_DEG), twin(FACE_DEG)
    with pytest.raises(CheckFailedError, match="face pose shows one"):
        find_grid(expose(corner), GridTarget(), "face")
    with pytest.raises(CheckFailedError, match="only one face"):
        find_grid(expose(face), GridTarget(), "corner")


@pytest.mark.parametrize(("rotation_deg", "pose"), [(CORNER_DEG, "corner"), (FACE_DEG, "face")])
def test_a_biprism_image_without_a_half(rotation_deg, pose):
    world = twin(rotation_deg, jack_mm=RAISED)
    with pytest.raises(CheckFailedError, match="half"):
        find_grid(expose(world), GridTarget(), pose)


def windowed(image, top, bottom, left, right):
    """The part of an image as another camera's whole frame."""
    return np.ascontiguousarray(image[top:bottom, left:right])


def test_a_face_seen_in_part_is_labelled_from_the_end_that_is_in_view():
    world = twin(FACE_DEG)
    image, dots = expose(world), truth(world)
    place = dots.xy_px[: GridTarget().dots_per_face]
    low, high = place.min(axis=0), place.max(axis=0)
    for box in (
        (0, int(high[1]) - 100, 0, 1280),
        (int(low[1]) + 100, 1024, 0, 1280),
        (0, 1024, 0, int(high[0]) - 60),
        (0, 1024, int(low[0]) + 60, 1280),
    ):
        finding = find_grid(windowed(image, *box), GridTarget(), "face")
        found = finding.xy_px + np.array([box[2], box[0]])
        assert len(found) > 120
        assert np.abs(found - place[finding.index]).max() < 0.15
        assert {m.reason for m in finding.missing} <= {"outside the image", "cut by the image's border"}


def test_a_view_without_any_end_needs_a_seed():
    world = twin(FACE_DEG)
    dots = truth(world)
    place = dots.xy_px[: GridTarget().dots_per_face]
    low, high = place.min(axis=0), place.max(axis=0)
    top, left = int(low[1]) + 50, int(low[0]) + 50
    part = windowed(expose(world), top, int(high[1]) - 50, left, int(high[0]) - 50)
    with pytest.raises(CheckFailedError, match="seed"):
        find_grid(part, GridTarget(), "face")
    known = GridTarget().index(0, 10, 4)
    xy = tuple(place[known] - [left, top] + [1.5, -1.0])
    finding = find_grid(part, GridTarget(), "face", seed=Seed(0, 10, 4, xy))
    assert np.abs(finding.xy_px + np.array([left, top]) - place[finding.index]).max() < 0.15
    assert len(finding.index) >= 90
    with pytest.raises(InputError, match="beyond the target"):
        find_grid(part, GridTarget(), "face", seed=Seed(0, 0, 4, xy))
    with pytest.raises(InputError, match="no dot at"):
        find_grid(part, GridTarget(), "face", seed=Seed(0, 10, 4, (xy[0] + 17.0, xy[1] + 17.0)))
    with pytest.raises(InputError, match="not on the target"):
        find_grid(part, GridTarget(), "face", seed=Seed(0, 23, 4, xy))


def test_a_corner_seen_in_part():
    """Rows cut at the bottom: labelled from the top. Rows cut at both ends: a seed on one face labels both."""
    world = twin()
    image, place = expose(world), truth(world).xy_px
    for (top, bottom), seed_dot in (((0, 800), None), ((200, 800), 200), ((200, 800), 207 + 100)):
        part, seed = windowed(image, top, bottom, 0, 1280), None
        if seed_dot is not None:
            with pytest.raises(CheckFailedError, match="seed"):
                find_grid(part, GridTarget(), "corner")
            face, row, column = (int(v) for v in GridTarget().face_row_column(np.array(100 + 207 * (seed_dot > 206))))
            x, y = place[GridTarget().index(face, row, column)]
            seed = Seed(face, row, column, (float(x), float(y) - top))
        finding = find_grid(part, GridTarget(), "corner", seed=seed)
        assert len(finding.index) > 250
        assert np.abs(finding.xy_px + np.array([0, top]) - place[finding.index]).max() < 0.15


def test_images_that_can_not_be_used():
    with pytest.raises(InputError, match="monochrome"):
        find_grid(np.zeros((50, 50, 3), np.uint8), GridTarget(), "face")
    with pytest.raises(InputError, match="type"):
        find_grid(np.zeros((50, 50), np.int32), GridTarget(), "face")
    with pytest.raises(InputError, match="finite"):
        find_grid(np.full((50, 50), np.nan), GridTarget(), "face")
    with pytest.raises(InputError, match="split line"):
        region = SplitRegion(SplitLine(5000.0, 0.0, True, 0.1, 25.0), "left")
        find_grid(np.zeros((50, 50), np.uint8), GridTarget(), "face", region=region)


def test_both_halves_of_a_face_image():
    world = twin(FACE_DEG, jack_mm=RAISED)
    image = expose(world)
    split = find_split([image])
    for half in ("left", "right"):
        finding = find_grid(image, GridTarget(), "face", region=SplitRegion(split, half))
        dots = truth(world, side=side_of(world, half))
        assert set(finding.index) == set(range(GridTarget().dots_per_face))
        assert np.abs(errors(finding, dots)).max() < 0.1
