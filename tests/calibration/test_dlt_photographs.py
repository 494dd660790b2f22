"""The plain DLT on MultiDIC's published centroids must give MultiDIC's published parameters."""

import numpy as np
import pytest
from scipy.io import loadmat

from bscd.calibration import fit_dlt, triangulate

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
