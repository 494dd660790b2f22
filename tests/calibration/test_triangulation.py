import numpy as np
import pytest

from bscd.calibration import triangulate
from bscd.calibration.triangulation_kernel import invert
from tests.calibration import plain_triangulation as plain
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


@pytest.mark.parametrize("method", ["linear", "optimal"])
@pytest.mark.parametrize("views", [2, 3])
def test_is_what_numpy_makes_of_it(method, views):
    rng = np.random.default_rng(3)
    images = [image(m, CORNER) + rng.normal(0, 0.3, (len(CORNER), 2)) for m in CAMERAS[:views]]
    images[1][5] = np.nan
    found, expected = (way(CAMERAS[:views], images, method) for way in (triangulate, plain.triangulate))
    np.testing.assert_allclose(found.xyz_mm, expected.xyz_mm, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.residual_px, expected.residual_px, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.jacobian, expected.jacobian, rtol=1e-7, atol=1e-10)
    spread = rng.normal(size=(len(CORNER), 2 * views, 2 * views))
    noise = spread @ np.swapaxes(spread, 1, 2)
    passed = found.jacobian @ noise @ np.swapaxes(found.jacobian, 1, 2)
    np.testing.assert_allclose(found.covariance_mm2(noise), passed, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.covariance_mm2(noise[0])[0], passed[0], rtol=1e-12, atol=1e-15)


class TestSmallInverses:
    """Cramer's rule against numpy.linalg."""

    RNG = np.random.default_rng(7)
    DESIGN = RNG.normal(size=(200, 4, 3)) * 10.0 ** RNG.uniform(-3, 3, (200, 1, 1))
    NORMAL = np.swapaxes(DESIGN, 1, 2) @ DESIGN

    @staticmethod
    def inverted(normal):
        out = np.empty((3, 3))
        invert(normal, out)
        return out

    @pytest.mark.parametrize("scale", [1.0, 1e-80, 1e80])
    def test_are_those_of_numpy(self, scale):
        for system in self.NORMAL * scale:
            expected = np.linalg.inv(system)
            found = self.inverted(system)
            assert np.abs(found - expected).max() < 1e-12 * np.linalg.cond(system) * np.abs(expected).max()

    @pytest.mark.parametrize(
        "system",
        [
            np.full((3, 3), np.nan),
            np.full((3, 3), np.inf),
            np.zeros((3, 3)),
            np.diag([1.0, 1.0, 0.0]),
            np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
        ],
        ids=["unknown", "infinite", "nothing", "flat", "a line"],
    )
    def test_systems_without_a_solution_give_nan(self, system):
        assert np.isnan(self.inverted(system)).all()


def test_no_points():
    assert triangulate(CAMERAS[:2], [np.zeros((0, 2)), np.zeros((0, 2))]).xyz_mm.shape == (0, 3)
