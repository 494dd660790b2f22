import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bscd.calibration import View, adjust_lattice, lattice_error_mm, pair_views
from bscd.errors import InputError
from tests.calibration.exact_rig import ExactRig


@pytest.mark.parametrize("poses", [("face",), ("face", "corner")])
def test_lattice_lies_where_the_dots_are(poses):
    rig = ExactRig(noise_px=0.0)
    lattice = adjust_lattice(rig.reference(poses=poses), rig.target, (1280, 1024))
    index = np.arange(207)
    for rotation, y in ((0.0, -16.0), (0.0, 7.0), (45.0, 3.0), (3.0, 1.0), (20.0, 0.0)):
        found = lattice.motion.points_mm(rig.target.points_mm(index), rotation, y)
        assert np.abs(found - rig.dots_mm(index, rotation, y)).max() < 1e-6
    assert np.allclose(lattice.motion.axis, rig.axis, atol=1e-7)
    assert np.allclose(lattice.motion.direction, rig.direction, atol=1e-7)
    offset = lattice.motion.axis_point_mm - np.asarray(rig.axis_point_mm)
    assert np.linalg.norm(np.cross(offset, rig.axis)) < 1e-5


def test_reported_sigma_covers_the_error():
    index, inside = np.arange(207), []
    for seed in range(12):
        rig = ExactRig(noise_px=0.05, seed=seed)
        lattice = adjust_lattice(rig.reference(positions=range(-8, 9, 2)), rig.target, (1280, 1024))
        grid = rig.target.points_mm(index)
        error = lattice.motion.points_mm(grid, 0.0, 4.0) - rig.dots_mm(index, 0.0, 4.0)
        inside.append(np.abs(error) < lattice.sigma_mm(grid, True, 4.0))
    # errors of one rig go together, so the share over rigs scatters widely: between one and three sigma's worth
    assert 0.4 < np.mean(inside) < 0.9


def test_wrong_labels_do_not_pass_silently():
    rig = ExactRig(noise_px=0.01)
    views = rig.reference(positions=range(-2, 3))
    wrong = [
        View(v.camera, v.pose, v.position, v.y_mm, v.rotation_deg, np.roll(v.index, 40), v.xy_px, v.sigma_px)
        if v.camera == "auxiliary" and v.pose == "corner"
        else v
        for v in views
    ]
    try:
        lattice = adjust_lattice(wrong, rig.target, (1280, 1024))
    except InputError:
        return
    assert lattice.rms_px["auxiliary"] > 1.0


def test_standard_error_is_free_of_the_pose_and_the_direction():
    rig = ExactRig(noise_px=0.0)
    paired = pair_views([v for v in rig.reference() if v.pose == "face"], "primary", "auxiliary")
    true = rig.dots_mm(paired.index, 0.0, 0.0) + np.multiply.outer(paired.y_mm, rig.direction)
    moved = Rotation.from_rotvec([0.1, -0.2, 0.3]).apply(true) + np.array([1.0, 2.0, 3.0])
    assert lattice_error_mm(paired, moved, rig.target).max() < 1e-9
    noise = np.random.default_rng(0).normal(0, 0.01, true.shape)
    found = lattice_error_mm(paired, moved + noise, rig.target)
    assert found.mean() == pytest.approx(np.linalg.norm(noise, axis=1).mean(), rel=0.01)


def test_missing_camera_is_named():
    rig = ExactRig(noise_px=0.01)
    only = [view for view in rig.reference(positions=range(3)) if view.camera == "primary"]
    with pytest.raises(InputError, match="no views of the auxiliary camera"):
        adjust_lattice(only, rig.target, (1280, 1024))
