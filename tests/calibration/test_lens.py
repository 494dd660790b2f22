"""The lens model against OpenCV's own, and its inverse."""

import cv2
import numpy as np
import pytest

from bscd.calibration.dlt import project
from bscd.calibration.lens import LensCamera

CAMERA = LensCamera(
    np.array([11200.0, 11190.0, 641.0, 509.0, -0.5, 0.3, 1e-3, -7e-4, 0.02, -0.17, 0.01, -4.0, 3.0, 622.0])
)
POINTS = np.random.default_rng(1).uniform([-30.0, -25.0, -20.0], [30.0, 25.0, 20.0], (200, 3))


def test_images_are_those_of_opencv():
    fx, fy, cx, cy = CAMERA.parameters[:4]
    inner = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    wanted, _ = cv2.projectPoints(
        POINTS, CAMERA.parameters[8:11], CAMERA.parameters[11:], inner, CAMERA.parameters[4:8]
    )
    np.testing.assert_allclose(CAMERA.project(POINTS), wanted[:, 0], atol=1e-8)


@pytest.mark.parametrize("k1", [-0.5, 0.5, 0.0])
def test_without_its_distortion_it_is_a_pinhole(k1):
    camera = LensCamera(np.concatenate([CAMERA.parameters[:4], [k1, *CAMERA.parameters[5:]]]))
    seen = camera.project(POINTS)
    np.testing.assert_allclose(camera.ideal_px(seen), project(camera.pinhole, POINTS), atol=1e-8)
    np.testing.assert_allclose(camera.distorted_px(project(camera.pinhole, POINTS)), seen, atol=1e-8)


def test_any_array_of_points_keeps_its_form():
    seen = CAMERA.project(POINTS).reshape(20, 10, 2)
    assert CAMERA.ideal_px(seen).shape == (20, 10, 2)
    assert np.isnan(CAMERA.ideal_px(np.full((1, 2), np.nan))).all()
