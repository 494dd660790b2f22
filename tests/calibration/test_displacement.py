"""How sure a displacement is, against the scatter of exact cameras' points whose images have known noise."""

from functools import cache

import numpy as np
import pytest

from bscd.calibration import Calibration, CalibrationChoices, ImageCovariances, calibrate, displacement_covariance
from bscd.calibration.triangulation import triangulate
from tests.calibration.exact_rig import ExactRig
from tests.calibration.test_dlt import image, pinhole

LEFT, RIGHT = pinhole((0.0, 0.0, 0.17), 622.0), pinhole((0.0, 0.0, -0.17), 622.0)
GRID = np.stack(np.meshgrid([-8.0, 0.0, 8.0], [0.0], [-8.0, 0.0, 8.0]), axis=-1).reshape(-1, 3)
STEREO = np.array([[4.0e-3, 1.0e-3], [1.0e-3, 2.0e-3]])
TRACKING = np.array([[1.0e-4, -3.0e-5], [-3.0e-5, 2.0e-4]])
NONE = np.zeros((2, 2))


def moved(points):
    return points * [1.12, 1.0, 1.05] + [0.5, -6.0, 0.2]


MOVED = moved(GRID)


def onward():
    """How the right view deforms at each point, from its images of a small cross on the object."""
    cross = [GRID + np.array(step) for step in ([0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 0.0, 1e-3])]
    arms = []
    for shape in (cross, [moved(points) for points in cross]):
        middle, *ends = (image(RIGHT, points) for points in shape)
        arms.append(np.stack([end - middle for end in ends], axis=2))
    return arms[1] @ np.linalg.inv(arms[0])


def independent(left_px2, right_px2, stereo_px2, onward_):
    """Covariances ``(N, 2, 2)`` each of errors that have nothing in common, as the images' own."""
    tracking, position = np.zeros((2, len(onward_), 4, 4))
    tracking[:, :2, :2], tracking[:, 2:, 2:] = left_px2, right_px2
    position[:, 2:, 2:] = onward_ @ stereo_px2 @ np.swapaxes(onward_, 1, 2)
    return ImageCovariances(tracking, stereo_px2, onward_, tracking + position)


def reported(stereo_px2, left_px2, right_px2):
    now, reference = (triangulate([LEFT, RIGHT], [image(LEFT, at), image(RIGHT, at)]) for at in (MOVED, GRID))
    count = len(GRID)
    images = independent(*(np.tile(c, (count, 1, 1)) for c in (left_px2, right_px2, stereo_px2)), onward())
    return images, displacement_covariance(now, reference, images, None), now


def scatter(stereo_px2, left_px2, right_px2, repeats=3000):
    """Covariance of displacements and of positions over repeated measurements with these noises."""
    rng = np.random.default_rng(4)
    count = len(GRID)
    stereo, left, right = (
        rng.multivariate_normal((0.0, 0.0), c, (repeats, count)) for c in (stereo_px2, left_px2, right_px2)
    )
    carried = np.einsum("nij,rnj->rni", onward(), stereo)
    images = [image(LEFT, GRID) + 0.0 * left, image(RIGHT, GRID) + stereo]
    later = [image(LEFT, MOVED) + left, image(RIGHT, MOVED) + carried + right]
    reference, now = (
        triangulate([LEFT, RIGHT], [seen.reshape(-1, 2) for seen in both]).xyz_mm.reshape(repeats, count, 3)
        for both in (images, later)
    )

    def covariance(values):
        about = values - values.mean(axis=0)
        return np.einsum("rni,rnj->nij", about, about) / repeats

    return covariance(now - reference), covariance(now)


def correlation_of_errors(found, expected):
    """Largest difference of two covariances in units of the expected variances."""
    sigma = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    return np.abs((found - expected) / (sigma[:, :, None] * sigma[:, None, :])).max()


@pytest.mark.parametrize(
    "noises",
    [(STEREO, NONE, NONE), (NONE, TRACKING, NONE), (NONE, NONE, TRACKING), (STEREO, TRACKING, 2.0 * TRACKING)],
    ids=["stereo", "left tracking", "right tracking", "all"],
)
def test_reported_covariance_is_the_scatter(noises):
    images, covariance, now = reported(*noises)
    displacement, position = scatter(*noises)
    assert correlation_of_errors(displacement, covariance) < 0.12
    assert correlation_of_errors(position, now.covariance_mm2(images.position_px2)) < 0.12


def test_the_shared_stereo_error_cancels_and_tracking_noise_counts_in_full():
    def depth_sigma(covariance):
        return np.sqrt(covariance[:, 1, 1])

    images, shared, now = reported(STEREO, NONE, NONE)
    assert (depth_sigma(shared) < 0.25 * depth_sigma(now.covariance_mm2(images.position_px2))).all()
    images, tracked, now = reported(NONE, TRACKING, TRACKING)
    assert np.allclose(tracked, now.covariance_mm2(images.position_px2), rtol=1e-12)


def test_errors_that_both_views_share_leave_the_depth_alone():
    now, reference = (triangulate([LEFT, RIGHT], [image(LEFT, at), image(RIGHT, at)]) for at in (MOVED, GRID))
    count, one = len(GRID), np.tile(np.eye(2), (len(GRID), 1, 1))
    none = np.zeros((count, 2, 2))
    alike = np.tile(np.kron(np.ones((2, 2)), 1e-4 * np.eye(2)), (count, 1, 1))
    apart = alike * np.kron([[1.0, -1.0], [-1.0, 1.0]], np.ones((2, 2)))
    depth = [
        np.sqrt(displacement_covariance(now, reference, ImageCovariances(some, none, one, some), None)[:, 1, 1])
        for some in (alike, apart)
    ]
    assert (depth[0] < 0.05 * depth[1]).all()


def test_nothing_moved_is_certain_but_for_the_tracking():
    still = triangulate([LEFT, RIGHT], [image(LEFT, GRID), image(RIGHT, GRID)])
    count = len(GRID)
    none, stereo = np.zeros((count, 2, 2)), np.tile(STEREO, (count, 1, 1))
    images = independent(none, none, stereo, np.tile(np.eye(2), (count, 1, 1)))
    assert np.abs(displacement_covariance(still, still, images, None)).max() < 1e-20


@cache
def calibration() -> Calibration:
    rig = ExactRig(noise_px=0.02)
    return calibrate(
        rig.reference(), rig.bsc(), rig.target, (1280, 1024), CalibrationChoices(degree=3), stage_sigma_mm=0.001
    )


def seen():
    control = calibration().control
    return control.left_px[::37], control.right_px[::37]


class TestThroughTheMaps:
    @pytest.mark.parametrize("corrected", [True, False])
    @pytest.mark.parametrize("per_point", [True, False])
    def test_reconstruct_is_located_points_described(self, corrected, per_point):
        found, (left, right) = calibration(), seen()
        covariance = np.diag([1e-4, 2e-4, 3e-4, 4e-4])
        if per_point:
            covariance = covariance * np.linspace(1.0, 2.0, len(left))[:, None, None]
        whole = found.reconstruct(left, right, corrected, covariance_px2=covariance)
        parts = found.describe(found.locate(left, right, corrected), covariance)
        for name in ("xyz_mm", "sigma_mm", "inside", "epipolar_px"):
            assert np.array_equal(getattr(whole, name), getattr(parts, name), equal_nan=True)

    def test_reconstruct_against_its_steps(self):
        found, (left, right) = calibration(), seen()
        matrices = [found.left.matrix, found.right.matrix]
        first = triangulate(matrices, [left, right]).xyz_mm
        shifts = found.maps.shifts_px(first)
        second = triangulate(matrices, [left + shifts[:, :2], right + shifts[:, 2:]])
        points = found.reconstruct(left, right, extrapolate=True, covariance_px2=np.eye(4) * 1e-4)
        assert np.abs(points.xyz_mm - second.xyz_mm).max() < 1e-12
        variance = np.diagonal(
            second.covariance_mm2(np.eye(4) * 1e-4 + found.maps.covariance_px2(first)), axis1=1, axis2=2
        )
        distance = np.linalg.norm(first[:, None] - found.control.distorted_mm, axis=2)
        reference = found.control.reference_sigma_mm[distance.argmin(axis=1)]
        assert np.allclose(points.sigma_mm, np.sqrt(variance + reference**2), rtol=1e-9)
        assert np.allclose(points.epipolar_px, np.linalg.norm(second.residual_px.reshape(-1, 4), axis=1))

    def test_outside_the_hull_nothing_is_known_unless_asked_for(self):
        found, (left, right) = calibration(), seen()
        far = left + [300.0, 0.0], right + [300.0, 0.0]
        assert np.isnan(found.locate(*far).points.xyz_mm[~found.locate(*far).inside]).all()
        beyond = found.locate(*far, extrapolate=True)
        assert not beyond.inside.all()
        assert np.isfinite(beyond.points.xyz_mm).all()

    def test_the_maps_count_by_their_difference(self):
        found, (left, right) = calibration(), seen()
        count = len(left)
        none, one = np.zeros((count, 2, 2)), np.tile(np.eye(2), (count, 1, 1))
        images = independent(none, none, none, one)
        rest, moved = (found.locate(*at, extrapolate=True) for at in ((left, right), (left + 30.0, right + 30.0)))
        assert np.abs(found.displacement_sigma_mm(rest, rest, images)).max() < 1e-12
        moving = found.displacement_sigma_mm(moved, rest, images)
        # one shared error of the maps, drawn from the coefficients' covariance, moves both positions
        rng = np.random.default_rng(3)
        smooth = found.maps
        draws = np.linalg.cholesky(smooth.normal_inverse)
        across = np.linalg.cholesky(smooth.residual_covariance_px2 + 1e-16 * np.eye(4))
        errors = []
        for _ in range(600):
            delta = draws @ rng.normal(size=(len(draws), 4)) @ across.T
            other = type(smooth)(
                smooth.degree,
                smooth.centre_mm,
                smooth.half_width_mm,
                smooth.coefficients + delta,
                smooth.normal_inverse,
                smooth.residual_covariance_px2,
            )
            shift = [other.shifts_px(at.uncorrected_mm) - smooth.shifts_px(at.uncorrected_mm) for at in (moved, rest)]
            errors.append(
                np.einsum("nij,nj->ni", moved.points.jacobian, shift[0])
                - np.einsum("nij,nj->ni", rest.points.jacobian, shift[1])
            )
        ratio = np.std(errors, axis=0) / moving
        assert np.abs(np.median(ratio, axis=0) - 1.0).max() < 0.1

    def test_an_unknown_point_leaves_the_others(self):
        found, (left, right) = calibration(), seen()
        count = len(left)
        holed = left.copy()
        holed[3] = np.nan
        some, one = np.tile(TRACKING, (count, 1, 1)), np.tile(np.eye(2), (count, 1, 1))
        images = independent(some, some, some, one)
        rest = found.locate(left, right, extrapolate=True)
        sigma = found.displacement_sigma_mm(found.locate(holed, right, extrapolate=True), rest, images)
        whole = found.displacement_sigma_mm(rest, rest, images)
        assert np.isnan(sigma[3]).all()
        assert np.allclose(np.delete(sigma, 3, axis=0), np.delete(whole, 3, axis=0))
