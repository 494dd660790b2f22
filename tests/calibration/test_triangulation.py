import numpy as np
import pytest

from bscd.calibration import triangulate
from bscd.calibration.triangulation import _solve
from tests.calibration.test_dlt import CORNER, image, pinhole

CAMERAS = [pinhole((0.0, 0.0, 0.17), 622.0), pinhole((0.0, 0.0, -0.17), 622.0), pinhole((0.2, 0.0, 0.0), 700.0)]


@pytest.mark.parametrize("method", ["linear", "optimal"])
@pytest.mark.parametrize("views", [2, 3])
def test_exact_images_give_the_points(method, views):
    found = triangulate(CAMERAS[:views], [image(m, CORNER) for m in CAMERAS[:views]], method)
    assert np.abs(found.xyz_mm - CORNER).max() < 1e-8
    assert np.abs(found.residual_px).max() < 1e-8


@pytest.mark.parametrize("method", ["linear", "optimal"])
def test_reported_covariance_is_the_scatter(method):
    rng = np.random.default_rng(1)
    exact = [image(m, CORNER) for m in CAMERAS[:2]]
    shape = (400, *CORNER.shape)
    found = np.empty(shape)
    for repeat in range(shape[0]):
        noisy = [xy + rng.normal(0, 0.1, xy.shape) for xy in exact]
        found[repeat] = triangulate(CAMERAS[:2], noisy, method).xyz_mm
    reported = triangulate(CAMERAS[:2], exact, method).covariance_mm2(np.eye(4) * 0.01)
    ratio = found.var(axis=0) / np.diagonal(reported, axis1=1, axis2=2)
    assert np.abs(ratio.mean(axis=0) - 1.0).max() < 0.03


def test_optimal_has_the_smallest_reprojection_error():
    rng = np.random.default_rng(2)
    noisy = [image(m, CORNER) + rng.normal(0, 2.0, (len(CORNER), 2)) for m in CAMERAS]
    best = triangulate(CAMERAS, noisy, "optimal")
    cost = np.sum(best.residual_px**2, axis=(1, 2))
    for nearby in rng.normal(0, 0.01, (20, 3)):
        others = np.stack([xy - image(m, best.xyz_mm + nearby) for m, xy in zip(CAMERAS, noisy, strict=True)], axis=1)
        assert np.all(np.sum(others**2, axis=(1, 2)) >= cost - 1e-9)


def test_an_unknown_image_gives_an_unknown_point_and_leaves_the_others():
    images = [image(m, CORNER) for m in CAMERAS[:2]]
    images[0][3] = np.nan
    found = triangulate(CAMERAS[:2], images).xyz_mm
    assert np.isnan(found[3]).all()
    assert np.abs(np.delete(found - CORNER, 3, axis=0)).max() < 1e-8


class TestSmallSystems:
    """Cramer's rule against numpy.linalg."""

    RNG = np.random.default_rng(7)
    DESIGN = RNG.normal(size=(200, 4, 3)) * 10.0 ** RNG.uniform(-3, 3, (200, 1, 1))
    NORMAL = np.swapaxes(DESIGN, 1, 2) @ DESIGN

    @pytest.mark.parametrize("scale", [1.0, 1e-80, 1e80])
    def test_vectors_and_matrices(self, scale):
        vectors, matrices = self.RNG.normal(size=(200, 3)), self.RNG.normal(size=(200, 3, 4))
        normal = self.NORMAL * scale
        expected = np.linalg.solve(normal, vectors[..., None])[..., 0]
        assert np.allclose(_solve(normal, vectors), expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
        for found, system, right in zip(_solve(normal, matrices), normal, matrices, strict=True):
            expected = np.linalg.solve(system, right)
            assert np.abs(found - expected).max() < 1e-12 * np.linalg.cond(system) * np.abs(expected).max()

    def test_systems_without_a_solution_give_nan_and_leave_the_others(self):
        normal, right = self.NORMAL.copy(), np.ones((200, 3))
        normal[3] = np.nan
        normal[5] = np.inf
        normal[7] = 0.0
        normal[9] = np.diag([1.0, 1.0, 0.0])
        normal[11] = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
        found = _solve(normal, right)
        bad = np.isin(np.arange(200), (3, 5, 7, 9, 11))
        assert np.isnan(found[bad]).all()
        assert np.array_equal(found[~bad], _solve(normal[~bad], right[~bad]))

    def test_no_systems(self):
        assert _solve(np.zeros((0, 3, 3)), np.zeros((0, 3))).shape == (0, 3)


def test_no_points():
    assert triangulate(CAMERAS[:2], [np.zeros((0, 2)), np.zeros((0, 2))]).xyz_mm.shape == (0, 3)
