import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bscd.calibration import GridTarget, fit_dlt
from bscd.errors import InputError

CORNER = GridTarget().points_mm()


def pinhole(rotation_vector, distance_mm, focal_px=11000.0):
    """K [R t] from textbook numbers, scaled so that its last element is 1."""
    looking = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    rotation = looking @ Rotation.from_rotvec(rotation_vector).as_matrix()
    inner = np.array([[focal_px, 0, 640.0], [0, focal_px, 512.0], [0, 0, 1.0]])
    matrix = inner @ np.column_stack([rotation, [0.0, 0.0, distance_mm]])
    return matrix / matrix[2, 3]


def image(matrix, points):
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


@pytest.mark.parametrize("method", ["linear", "normalised", "refined"])
@settings(max_examples=20, deadline=None)
@given(
    tilt=st.tuples(*[st.floats(-0.4, 0.4)] * 3),
    distance=st.floats(300.0, 1500.0),
)
def test_finds_the_camera_of_exact_images(method, tilt, distance):
    matrix = pinhole(tilt, distance)
    camera = fit_dlt(CORNER, image(matrix, CORNER), method)
    assert np.abs(camera.project(CORNER) - image(matrix, CORNER)).max() < 1e-6
    assert camera.rms_px < 1e-6


def test_refinement_minimises_the_reprojection_error():
    rng = np.random.default_rng(3)
    pixels = image(pinhole((0.1, 0.2, 0.0), 622.0), CORNER) + rng.normal(0, 0.5, (len(CORNER), 2))
    plain, refined = fit_dlt(CORNER, pixels, "linear"), fit_dlt(CORNER, pixels, "refined")
    assert refined.rms_px < plain.rms_px
    for place in range(11):  # no coefficient can be changed for the better
        for sign in (-1.0, 1.0):
            moved = refined.coefficients.copy()
            moved[place] += sign * np.sqrt(refined.covariance[place, place]) * 0.01
            worse = image(np.append(moved, 1.0).reshape(3, 4), CORNER) - pixels
            assert np.sqrt(np.mean(worse**2)) >= refined.rms_px


def test_covariance_is_the_scatter_over_repeated_images():
    rng = np.random.default_rng(5)
    exact = image(pinhole((0.1, 0.2, 0.0), 622.0), CORNER)
    fits = [fit_dlt(CORNER, exact + rng.normal(0, 0.1, exact.shape)) for _ in range(300)]
    scatter = np.std([fit.coefficients for fit in fits], axis=0)
    reported = np.mean([np.sqrt(np.diag(fit.covariance)) for fit in fits], axis=0)
    assert np.allclose(reported / scatter, 1.0, atol=0.15)


def test_points_in_one_plane_are_refused():
    face = CORNER[:207]
    with pytest.raises(InputError, match="one plane"):
        fit_dlt(face, image(pinhole((0.1, 0.2, 0.0), 622.0), face))


def test_too_few_points_are_refused():
    with pytest.raises(InputError, match="5 control points, at least 6"):
        fit_dlt(CORNER[::90], image(pinhole((0, 0, 0), 622.0), CORNER[::90]))
