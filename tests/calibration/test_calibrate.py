"""The calibration against the exact rays: the paper's figures, the floor, the reported uncertainty."""

from dataclasses import replace
from itertools import pairwise

import h5py
import numpy as np
import pytest

from bscd.analysis.validation import validate
from bscd.calibration import Calibration, CalibrationChoices, calibrate, pair_views
from bscd.errors import InputError
from tests.calibration.exact_rig import ExactRig, paper_camera, paper_prism

SIZE = (1280, 1024)
VARIANTS = [(s, i) for s in ("projection", "smallest") for i in ("smooth", "linear")]


def make(rig, choices=None, **kwargs):
    return calibrate(rig.reference(**kwargs), rig.bsc(**kwargs), rig.target, SIZE, choices or CalibrationChoices())


def second(rig, calibration, shift_mm=(0.7, 0.0, -0.4), rotation_deg=3.0, repeats=2):
    """(error, floor, sigma, truth) of dots that took no part, inside the hull, ``(N, 3)`` each."""
    rows = []
    for _ in range(repeats):
        views = rig.second_acquisition(shift_mm, rotation_deg)
        seen = pair_views(views, "left", "right")
        truth = np.empty((len(seen.index), 3))
        for y in np.unique(seen.y_mm):
            here = seen.y_mm == y
            truth[here] = rig.dots_mm(seen.index[here], rotation_deg, y, shift_mm)
        found = calibration.reconstruct(seen.first_px, seen.second_px)
        floor = rig.floor_mm(seen.first_px, seen.second_px) - truth
        rows.append([a[found.inside] for a in (found.xyz_mm - truth, floor, found.sigma_mm, truth)])
        assert found.inside.mean() > 0.8
        assert np.isnan(found.xyz_mm[~found.inside]).all()
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def mean_distance(vectors):
    return np.linalg.norm(vectors, axis=1).mean()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_papers_figures_at_a_tenth_of_a_pixel(seed):
    rig = ExactRig(noise_px=0.1, seed=seed)
    calibration = make(rig, CalibrationChoices(reference="raw", interpolant="linear"))
    assert calibration.figures["standard_stereo_error_mean_mm"] == pytest.approx(0.021, rel=0.15)
    again = validate(calibration, [rig.view(c, "face", 0) for c in ("left", "right")], rig.target)
    assert again.figure("uncorrected").mean_mm == pytest.approx(0.17, rel=0.15)
    error, floor, _, _ = second(rig, calibration)
    assert mean_distance(error) <= 1.25 * mean_distance(floor)


@pytest.mark.parametrize("poses", [("face",), ("face", "corner")])
@pytest.mark.parametrize("noise_px", [0.005, 0.01])
def test_the_lattice_reaches_the_floor_in_each_third_of_the_depth(noise_px, poses):
    rig = ExactRig(noise_px=noise_px, seed=5)
    error, floor, _, truth = second(rig, make(rig, poses=poses), repeats=4)
    assert mean_distance(error) <= 1.1 * mean_distance(floor)
    edges = np.quantile(truth[:, 1], [0, 1 / 3, 2 / 3, 1])
    for low, high in pairwise(edges):
        third = (truth[:, 1] >= low) & (truth[:, 1] <= high)
        assert mean_distance(error[third]) <= 1.1 * mean_distance(floor[third])
        assert mean_distance(error[third]) <= 0.015


@pytest.mark.parametrize("noise_px", [0.01, 0.1])
@pytest.mark.parametrize("solver", ["projection", "smallest"])
def test_sigma_covers_68_percent(noise_px, solver):
    rig = ExactRig(noise_px=noise_px, seed=9)
    error, _, sigma, _ = second(rig, make(rig).choose(solver, "smooth"), repeats=3)
    share = np.mean(np.abs(error) < sigma, axis=0)
    assert np.all(np.abs(share - 0.68) < 0.06), share


def test_stage_repeatability_enters_sigma():
    """Against a Monte Carlo: the target placed twice, each time off by the stages' repeatability."""
    rig = ExactRig(noise_px=0.003, seed=3)
    scans = rig.reference(positions=range(-3, 4)), rig.bsc(positions=range(-3, 4)), rig.target, SIZE
    still, shaky = calibrate(*scans), calibrate(*scans, stage_sigma_mm=0.01, stage_sigma_deg=0.05)
    added = np.sqrt(shaky.control.reference_sigma_mm**2 - still.control.reference_sigma_mm**2)
    rows = np.flatnonzero(still.control.face_pose)[:200:20]
    index, y_mm = still.control.index[rows], 2.0 * still.control.position[rows][0]
    rng = np.random.default_rng(0)
    placed = [
        [rig.dots_mm(index, 0.05 * rng.normal(), y_mm + 0.01 * rng.normal()) for _ in range(2)] for _ in range(2000)
    ]
    scatter = np.std([first - second for first, second in placed], axis=0)
    assert np.allclose(added[rows][:, :2], scatter[:, :2], rtol=0.1)


def test_nothing_relies_on_the_papers_geometry():
    rig = ExactRig(
        noise_px=0.02,
        seed=11,
        primary=paper_camera((4.0, -500.0, -6.0), focal_length_mm=58.0, k1=0.8),
        prism=paper_prism((-1.1, 0.9, 0.7), (1.5, -180.0, 3.0)),
        axis_point_mm=(-1.5, 11.0, 0.0),
    )
    error, floor, _, _ = second(rig, make(rig), shift_mm=(0.3, 0.0, 0.6), rotation_deg=-2.0)
    assert mean_distance(error) <= 1.1 * mean_distance(floor)


def test_correction_on_its_own_images_is_exact_by_construction():
    rig = ExactRig(noise_px=0.1, seed=2)
    calibration = make(rig).choose("smallest", "linear")
    control = calibration.control
    found = calibration.reconstruct(control.left_px, control.right_px)
    error = np.linalg.norm(found.xyz_mm - control.reference_mm, axis=1)[found.inside]
    assert error.size > 3000
    assert error.max() < 1e-6


def test_outside_the_hull():
    rig = ExactRig(noise_px=0.01)
    calibration = make(rig)
    far = rig.dots_mm(np.arange(207), 0.0, 22.0)
    left, right = (rig.image(side, np.arange(207), far)[1] for side in ("left", "right"))
    closed = calibration.reconstruct(left, right)
    open_ = calibration.reconstruct(left, right, extrapolate=True)
    assert not closed.inside.any()
    assert np.isnan(closed.xyz_mm).all()
    assert np.isnan(closed.sigma_mm).all()
    assert not open_.inside.any()
    assert np.linalg.norm(open_.xyz_mm - far, axis=1).mean() < 0.1
    middle = rig.view("left", "face", 0), rig.view("right", "face", 0)
    at_home = calibration.reconstruct(middle[0].xy_px, middle[1].xy_px)
    assert np.median(open_.sigma_mm[:, 1]) > np.nanmedian(at_home.sigma_mm[:, 1])


@pytest.mark.parametrize(("solver", "interpolant"), VARIANTS)
def test_saved_and_loaded_it_reconstructs_the_same(tmp_path, solver, interpolant):
    rig = ExactRig(noise_px=0.05)
    made = make(rig, positions=range(-3, 4)).choose(solver, interpolant)
    made.save(tmp_path / "cal.h5")
    loaded = Calibration.load(tmp_path / "cal.h5")
    views = [rig.view(side, "face", 1) for side in ("left", "right")]
    first, again = (c.reconstruct(views[0].xy_px, views[1].xy_px) for c in (made, loaded))
    assert np.array_equal(first.xyz_mm, again.xyz_mm, equal_nan=True)
    assert np.array_equal(first.sigma_mm, again.sigma_mm, equal_nan=True)
    assert loaded.checksum == made.checksum
    assert loaded.figures == made.figures
    assert loaded.choices == made.choices
    assert loaded.image_size_px == made.image_size_px == {"primary": SIZE, "auxiliary": SIZE}
    with pytest.raises(InputError, match="exists already"):
        made.save(tmp_path / "cal.h5")


def test_it_is_for_the_image_sizes_of_each_camera(tmp_path):
    rig = ExactRig(noise_px=0.05)
    steps = {"positions": range(-3, 4)}
    scans = rig.reference(**steps), rig.bsc(**steps), rig.target, SIZE
    made, other = calibrate(*scans), calibrate(*scans, auxiliary_size_px=(1280, 1040))
    other.save(tmp_path / "cal.h5")
    assert Calibration.load(tmp_path / "cal.h5").image_size_px == {"primary": SIZE, "auxiliary": (1280, 1040)}
    renamed = replace(made, image_size_px={"primary": SIZE, "auxiliary": (1280, 1040)})
    assert renamed.checksum != made.checksum


def test_the_principal_point_is_looked_for_in_the_middle_of_each_cameras_images():
    """Rows added above the auxiliary camera's images move everything in them, and its calibration with them."""
    rig, added = ExactRig(noise_px=0.01, seed=6), 400.0
    steps = {"positions": range(-3, 4)}
    reference, bsc = rig.reference(**steps), rig.bsc(**steps)
    lower = [
        replace(view, xy_px=view.xy_px + [0.0, added]) if view.camera == "auxiliary" else view for view in reference
    ]
    made = calibrate(reference, bsc, rig.target, SIZE)
    moved = calibrate(lower, bsc, rig.target, SIZE, auxiliary_size_px=(1280, 1824))
    first, second = (one.lenses["auxiliary"].parameters for one in (made, moved))
    assert second[3] - first[3] == pytest.approx(added, abs=0.05)
    np.testing.assert_allclose(moved.control.reference_mm, made.control.reference_mm, atol=1e-5)


def test_a_file_of_an_older_version_is_refused(tmp_path):
    make(ExactRig(noise_px=0.05), positions=range(-3, 4)).save(tmp_path / "cal.h5")
    with h5py.File(tmp_path / "cal.h5", "r+") as file:
        assert file.attrs["format_version"] == 3
        file.attrs["format_version"] = 2
        del file["image_size_px"]
    with pytest.raises(InputError, match="another version of bscd; calibrate again from the run files"):
        Calibration.load(tmp_path / "cal.h5")


def test_files_that_are_no_calibration_are_named(tmp_path):
    (tmp_path / "text.h5").write_text("not HDF5")
    for name, words in (("text.h5", "damaged or not"), ("none.h5", "no such calibration")):
        with pytest.raises(InputError, match=words):
            Calibration.load(tmp_path / name)


def test_a_moved_prism_is_noticed():
    rig = ExactRig(noise_px=0.02, seed=3)
    calibration = make(rig)

    def check():
        views = [rig.view(side, "face", 2) for side in ("left", "right")]
        return calibration.moved(calibration.reconstruct(views[0].xy_px, views[1].xy_px))

    assert not check()
    rig.prism = paper_prism((0.3, -0.35, 0.2))  # rolled by 0.05 deg about the line of sight
    assert check()


def test_scans_that_do_not_belong_together_are_refused():
    rig = ExactRig(noise_px=0.02)
    bsc = [rig.view(v.camera, v.pose, v.position, v.y_mm + 0.05) for v in rig.bsc(positions=range(-3, 4))]
    with pytest.raises(InputError, match=r"do not belong together.*\+0\.0500 mm"):
        calibrate(rig.reference(positions=range(-3, 4)), bsc, rig.target, SIZE)


def test_three_positions_are_refused():
    with pytest.raises(InputError, match=r"3 positions, maps of degree 4 need at least 5"):
        make(ExactRig(noise_px=0.02), positions=(-1, 0, 1))


def test_missing_corner_is_named():
    rig = ExactRig(noise_px=0.02)
    with pytest.raises(InputError, match=r"no corner pose at POS\.0 in the left view"):
        calibrate(rig.reference(), [v for v in rig.bsc() if v.pose == "face"], rig.target, SIZE)


def test_imported_scans_need_no_rotation_readings():
    rig = ExactRig(noise_px=0.02, seed=4)

    def unread(views):
        return [replace(view, rotation_deg=float("nan")) for view in views]

    calibration = calibrate(unread(rig.reference()), unread(rig.bsc()), rig.target, SIZE)
    error, floor, _, _ = second(rig, calibration)
    assert mean_distance(error) <= 1.1 * mean_distance(floor)
    again = validate(calibration, unread([rig.view(c, "face", 3) for c in ("left", "right")]), rig.target)
    assert again.figure("corrected").mean_mm < 0.03
