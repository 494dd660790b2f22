"""The plain DLT on MultiDIC's published centroids must give MultiDIC's published parameters."""

import cv2
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.optimize import least_squares

from bscd.calibration import fit_dlt, triangulate
from bscd.calibration.dots import find_marks

pytestmark = pytest.mark.real_data


def stored(folder, camera):
    data = loadmat(folder / f"multidic-dlt/DLTstruct_cam_{camera}.mat", simplify_cells=True)["DLTstructCam"]
    columns = np.asarray(data["columns"], int) - 1
    points = data["C3Dtrue"][:, columns].transpose(1, 0, 2).reshape(-1, 3)
    return columns, points, np.asarray(data["imageCentroids"], float), np.ravel(data["DLTparams"])


@pytest.mark.parametrize("camera", [201, 202])
def test_linear_fit_equals_the_published_parameters(real_data, camera):
    _, points, centroids, parameters = stored(real_data, camera)
    fitted = fit_dlt(points, centroids.reshape(-1, 2), "linear").coefficients
    assert np.abs(fitted / parameters - 1.0).max() < 1e-8


def test_the_cylinder_comes_back_from_the_published_centroids(real_data):
    (first_columns, points_a, xy_a, _), (second_columns, points_b, xy_b, _) = (stored(real_data, c) for c in (201, 202))
    cameras = [fit_dlt(points_a, xy_a.reshape(-1, 2)), fit_dlt(points_b, xy_b.reshape(-1, 2))]
    both = np.intersect1d(first_columns, second_columns)
    pick = [np.isin(columns, both).repeat(20) for columns in (first_columns, second_columns)]
    found = triangulate([c.matrix for c in cameras], [xy_a.reshape(-1, 2)[pick[0]], xy_b.reshape(-1, 2)[pick[1]]])
    true = points_a[pick[0]]
    assert len(true) >= 100
    # GoPro lenses uncorrected: their distortion of 3 px rms bounds it, at about 0.1 mm a pixel
    assert np.median(np.linalg.norm(found.xyz_mm - true, axis=1)) < 0.5


def test_our_own_marks_give_the_cylinders_radius(real_data):
    """Both photographs from the marks that we find; the lenses' distortion (2.4 px rms) stays uncorrected."""
    seen = []
    for camera in (201, 202):
        columns, points, centroids, _ = stored(real_data, camera)
        image = cv2.imread(str(real_data / f"multidic-dlt/{camera}.jpg"), cv2.IMREAD_GRAYSCALE)
        marks = find_marks(image).xy_px
        distance = np.linalg.norm(marks[None] - centroids.reshape(-1, 1, 2), axis=2)
        found = distance.min(axis=1) < 2.0
        assert found.mean() >= 0.95
        labels = {(c, r): n for n, (c, r) in enumerate((c, r) for c in columns for r in range(20)) if found[n]}
        pixels = marks[distance.argmin(axis=1)]
        seen.append((labels, points, pixels, fit_dlt(points[found], pixels[found])))
    (first, points, xy_a, camera_a), (second, _, xy_b, camera_b) = seen
    both = sorted(first.keys() & second.keys())
    pair = [xy_a[[first[k] for k in both]], xy_b[[second[k] for k in both]]]
    xyz = triangulate([camera_a.matrix, camera_b.matrix], pair).xyz_mm
    true = points[[first[k] for k in both]]
    assert len(both) >= 95

    def radius(cloud):
        fitted = least_squares(
            lambda v: np.hypot(cloud[:, 0] - v[0], cloud[:, 1] - v[1]) - v[2], [0.0, 0.0, np.ptp(cloud[:, 0])]
        )
        return fitted.x[2]

    assert radius(xyz) == pytest.approx(radius(true), rel=0.01)
    assert np.linalg.norm(xyz - true, axis=1).mean() < 0.5
