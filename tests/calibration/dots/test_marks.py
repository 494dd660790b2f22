"""Marks of other shapes and on curved bodies: drawn here with known centres, and MultiDIC's photographs."""

import cv2
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.ndimage import gaussian_filter

from bscd.calibration import PointsTarget, fit_dlt
from bscd.calibration.dots import MarkSeed, find_marks, match_marks
from bscd.errors import CheckFailedError, InputError
from tests.calibration.dots.twin_views import polygon_centroid

FINE = 8
RADIUS_MM, ROWS, COLUMNS, PITCH_MM, SIDE_MM = 30.0, 9, 16, 10.0, 5.0


def cylinder():
    """Marks ``(ROWS * COLUMNS, 3)`` on a cylinder, corners of the square marks ``(.., 24, 3)``, and their labels."""
    row, column = np.meshgrid(np.arange(ROWS), np.arange(COLUMNS), indexing="ij")
    angle, z = 2 * np.pi * column.ravel() / COLUMNS, PITCH_MM * (row.ravel() - (ROWS - 1) / 2)
    t = np.linspace(-0.5, 0.5, 7)[:-1] * SIDE_MM
    h = np.full(6, SIDE_MM / 2)
    outline = np.concatenate([[t, -h], [h, t], [-t, h], [-h, -t]], axis=1)
    a = angle[:, None] + outline[0] / RADIUS_MM

    def on(angle, z):
        return np.stack([RADIUS_MM * np.sin(angle), -RADIUS_MM * np.cos(angle), z], axis=-1)

    labels = tuple(f"{r}.{c}" for r, c in zip(row.ravel(), column.ravel(), strict=True))
    return on(angle, z), on(a, z[:, None] + outline[1]), labels


def camera():
    """A projection matrix that looks along +y from 400 mm, slightly from above."""
    tilt = np.deg2rad(8.0)
    turn = np.array([[1, 0, 0], [0, -np.sin(tilt), -np.cos(tilt)], [0, np.cos(tilt), -np.sin(tilt)]])
    place = np.array([10.0, -400.0, 50.0])
    inner = np.array([[2600.0, 0, 400.0], [0, 2600.0, 480.0], [0, 0, 1]])
    return inner @ np.column_stack([turn, -turn @ place]), place


def photograph(k1=0.0, noise=2.0):
    """The cylinder through `camera` and radial distortion; the images of the marks' centroids."""
    points, outlines, labels = cylinder()
    matrix, place = camera()

    def project(xyz):
        image = xyz @ matrix[:, :3].T + matrix[:, 3]
        xy = image[..., :2] / image[..., 2:] - (400.0, 480.0)
        return xy * (1 + k1 * np.sum((xy / 2600.0) ** 2, axis=-1, keepdims=True)) + (400.0, 480.0)

    fine = np.full((960 * FINE, 800 * FINE), 190, np.uint8)
    normal = points * [1, 1, 0] / RADIUS_MM
    cosine = np.einsum("ni,ni->n", normal, (place - points) / np.linalg.norm(place - points, axis=1)[:, None])
    for k in np.flatnonzero(cosine > 0.05):
        at = ((project(outlines[k]) + 0.5) * FINE - 0.5) * 16
        cv2.fillPoly(fine, [np.rint(at).astype(np.int32)], 45, shift=4)
    image = fine.reshape(960, FINE, 800, FINE).mean(axis=(1, 3)) * np.linspace(0.8, 1.1, 800)
    image = gaussian_filter(image, 0.7) + np.random.default_rng(0).normal(0, noise, (960, 800))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), polygon_centroid(project(outlines)), cosine, labels, points


def test_centroids_of_squares_on_a_cylinder():
    image, true, cosine, _, _ = photograph()
    marks = find_marks(image, size_px=(10.0, 60.0))
    for k in np.flatnonzero(cosine > 0.5):
        near = np.linalg.norm(marks.xy_px - true[k], axis=1)
        assert near.min() < 0.1
        assert marks.contrast[near.argmin()] > 80
    assert len(find_marks(image, size_px=(100.0, 200.0))) == 0
    assert len(find_marks(image, contrast=250.0)) == 0


@pytest.mark.parametrize("k1", [0.0, -0.6])
def test_matching_from_seeds_and_from_a_camera(k1):
    image, true, cosine, labels, points = photograph(k1)
    target = PointsTarget(labels, points, SIDE_MM)
    marks = find_marks(image)
    frontal = np.flatnonzero(cosine > 0.7)
    seeds = [MarkSeed(labels[k], tuple(true[k])) for k in frontal[[0, 2, 3, len(frontal) // 2, -4, -2, -1]]]
    from_seeds = match_marks(marks, target, seeds=seeds)
    rough = fit_dlt(points[frontal], true[frontal] + np.random.default_rng(1).normal(0, 3, (len(frontal), 2)))
    for finding in (from_seeds, match_marks(marks, target, camera=rough)):
        assert set(np.flatnonzero(cosine > 0.35)) <= set(finding.index)
        assert np.linalg.norm(finding.xy_px - true[finding.index], axis=1).max() < 1.0
        assert all(m.reason.startswith("turned away") for m in finding.missing if cosine[m.index] < 0.2)
        assert len(finding.index) + len(finding.missing) == len(labels)


def test_what_can_not_be_matched():
    image, true, cosine, labels, points = photograph()
    target = PointsTarget(labels, points, SIDE_MM)
    marks = find_marks(image)
    front = np.flatnonzero(cosine > 0.7)[[0, 2, 5, 9, 12, 15]]
    good = [MarkSeed(labels[k], tuple(true[k])) for k in front]
    with pytest.raises(InputError, match="at least 6"):
        match_marks(marks, target, seeds=good[:5])
    with pytest.raises(InputError, match="not in the target"):
        match_marks(marks, target, seeds=[*good, MarkSeed("nowhere", (1, 2))])
    with pytest.raises(InputError, match="no mark at"):
        match_marks(marks, target, seeds=[*good, MarkSeed(labels[0], (5.0, 5.0))])
    mixed = [MarkSeed(labels[a], tuple(true[b])) for a, b in zip(front, np.roll(front, 3), strict=True)]
    with pytest.raises((CheckFailedError, InputError)):
        match_marks(marks, target, seeds=mixed)


@pytest.mark.real_data
@pytest.mark.parametrize("name", [201, 202])
def test_photographs(real_data, name):
    """MultiDIC's cylinder: >= 95 % of the listed marks within 2 px of the stored centroids, no label wrong."""
    folder = real_data / "multidic-dlt"
    image = cv2.imread(str(folder / f"{name}.jpg"), cv2.IMREAD_GRAYSCALE)
    stored = loadmat(folder / f"DLTstruct_cam_{name}.mat", simplify_cells=True)["DLTstructCam"]
    centroids = np.asarray(stored["imageCentroids"], float) - 1.0  # MATLAB counts pixels from 1
    marks = find_marks(image)
    off = np.linalg.norm(marks.xy_px[None] - centroids[:, None], axis=2).min(axis=1)
    assert (off < 2.0).mean() >= 0.95
    points = stored["C3Dtrue"].transpose(1, 0, 2).reshape(-1, 3)
    labels = tuple(f"{column + 1}.{row + 1}" for column in range(14) for row in range(20))
    listed = np.concatenate([np.arange(20) + 20 * (column - 1) for column in stored["columns"]])
    last = len(listed) - 1
    pick = [0, 10, 19, last // 2 - 5, last // 2 + 5, last - 19, last - 9, last]
    seeds = [MarkSeed(labels[listed[k]], tuple(centroids[k])) for k in pick]
    finding = match_marks(marks, PointsTarget(labels, points, 4.0), seeds=seeds)
    place = dict(zip(finding.index.tolist(), finding.xy_px, strict=True))
    miss = np.array([np.linalg.norm(place[k] - xy) for k, xy in zip(listed, centroids, strict=True) if k in place])
    assert len(miss) >= 0.95 * len(listed)
    assert miss.max() < 2.0
