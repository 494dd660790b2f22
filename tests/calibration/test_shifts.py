import numpy as np
import pytest

from bscd.calibration import triangulate
from bscd.calibration.shifts import solve_shifts
from tests.calibration.test_dlt import CORNER, image, pinhole

LEFT, RIGHT = pinhole((0.0, 0.0, 0.05), 622.0), pinhole((0.0, 0.0, -0.05), 622.0)


@pytest.fixture
def distorted():
    rng = np.random.default_rng(4)
    return image(LEFT, CORNER) + rng.normal(0, 2, (414, 2)), image(RIGHT, CORNER) + rng.normal(0, 2, (414, 2))


@pytest.mark.parametrize("triangulation", ["linear", "optimal"])
@pytest.mark.parametrize("solver", ["projection", "smallest"])
def test_shifted_images_meet_the_reference(distorted, solver, triangulation):
    left, right = distorted
    shifts = solve_shifts(LEFT, RIGHT, left, right, CORNER, solver, triangulation)
    met = triangulate([LEFT, RIGHT], [left + shifts[:, :2], right + shifts[:, 2:]], triangulation).xyz_mm
    assert np.linalg.norm(met - CORNER, axis=1).max() < 1e-6


def test_smallest_shifts_are_the_smallest(distorted):
    """With the optimal triangulation they are the projection's shifts less the part that leaves the point alone."""
    left, right = distorted
    projection = solve_shifts(LEFT, RIGHT, left, right, CORNER, "projection")
    smallest = solve_shifts(LEFT, RIGHT, left, right, CORNER, "smallest", "optimal")
    assert np.all(np.linalg.norm(smallest, axis=1) <= np.linalg.norm(projection, axis=1) + 1e-9)
    step = 1e-4
    slope = [
        (image(m, CORNER + step * axis) - image(m, CORNER - step * axis)) / (2 * step)
        for axis in np.eye(3)
        for m in (LEFT, RIGHT)
    ]
    design = np.stack([np.concatenate(slope[2 * i : 2 * i + 2], axis=1) for i in range(3)], axis=2)
    kept = design @ np.linalg.pinv(design)  # onto what moves the point
    expected = np.einsum("nij,nj->ni", kept, projection)
    assert np.abs(smallest - expected).max() < 1e-5


@pytest.mark.parametrize("triangulation", ["linear", "optimal"])
def test_smallest_shifts_equal_a_general_optimiser(distorted, triangulation):
    """The paper's fmincon, one point at a time, with scipy's SLSQP."""
    from scipy.optimize import minimize

    left, right = distorted
    shifts = solve_shifts(LEFT, RIGHT, left, right, CORNER, "smallest", triangulation)
    for point in (0, 111, 333):

        def miss(s, point=point):
            moved = [left[point : point + 1] + s[:2], right[point : point + 1] + s[2:]]
            return (triangulate([LEFT, RIGHT], moved, triangulation).xyz_mm - CORNER[point]).ravel()

        found = minimize(
            lambda s: s @ s, np.zeros(4), method="SLSQP", constraints={"type": "eq", "fun": miss}, tol=1e-14
        )
        assert np.linalg.norm(found.x) == pytest.approx(np.linalg.norm(shifts[point]), rel=1e-4)
