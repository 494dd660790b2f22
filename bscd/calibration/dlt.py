"""Direct linear transformation: one camera as 11 coefficients (paper, equation 2; Abdel-Aziz & Karara 1971)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bscd.arrays import FloatArray
from bscd.errors import InputError

DltMethod = Literal["linear", "normalised", "refined"]

MIN_POINTS = 6
_ITERATIONS = 30


@dataclass(frozen=True)
class DltCamera:
    """A camera as 11 DLT coefficients.

    ``coefficients`` ``(11,)`` are L1..L11 of the paper's equation 2 (px, mm); ``covariance`` ``(11, 11)`` theirs,
    from the residuals of the fit; ``rms_px`` the root mean square residual per axis.
    """

    coefficients: FloatArray
    covariance: FloatArray
    rms_px: float

    @property
    def matrix(self) -> FloatArray:
        """The projection matrix ``(3, 4)`` whose last element is 1."""
        return np.append(self.coefficients, 1.0).reshape(3, 4)

    def project(self, points_mm: FloatArray) -> FloatArray:
        """Images ``(N, 2)`` px of points ``(N, 3)`` mm."""
        return project(self.matrix, points_mm)


def project(matrix: FloatArray, points_mm: FloatArray) -> FloatArray:
    """Perspective images ``(..., 2)`` px of points ``(..., 3)`` mm by a projection matrix ``(3, 4)``."""
    image = points_mm @ matrix[:, :3].T + matrix[:, 3]
    return image[..., :2] / image[..., 2:]


def fit_dlt(points_mm: FloatArray, xy_px: FloatArray, method: DltMethod = "refined") -> DltCamera:
    """Fit the 11 coefficients to control points ``(N, 3)`` mm and their images ``(N, 2)`` px.

    Parameters
    ----------
    points_mm, xy_px
        Corresponding points; at least 6, and not all in one plane.
    method
        "linear": the textbook's least squares on equation 2 multiplied out; "normalised": the same after
        Hartley's normalisation; "refined": then the reprojection error minimised (Gauss-Newton).

    Raises
    ------
    InputError
        Too few points, or points that leave the coefficients undetermined (all in one plane).
    """
    points, pixels = np.asarray(points_mm, np.float64), np.asarray(xy_px, np.float64)
    if len(points) < MIN_POINTS:
        raise InputError(f"DLT: {len(points)} control points, at least {MIN_POINTS} are needed")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[2] < 1e-6 * spread[0]:
        raise InputError("DLT: all control points lie in one plane; image both faces of the corner")
    if method == "linear":
        coefficients = _solve_linear(points, pixels)
        return DltCamera(coefficients, *_covariance(coefficients, points, pixels))
    to_points, to_pixels = _normalisation(points), _normalisation(pixels)
    unit_points, unit_pixels = _apply(to_points, points), _apply(to_pixels, pixels)
    unit = _solve_linear(unit_points, unit_pixels)
    if method == "refined":
        unit = _refine(unit, unit_points, unit_pixels)
    matrix = np.linalg.inv(to_pixels) @ np.append(unit, 1.0).reshape(3, 4) @ to_points
    coefficients = (matrix / matrix[2, 3]).ravel()[:11]
    return DltCamera(coefficients, *_covariance(coefficients, points, pixels))


def _solve_linear(points: FloatArray, pixels: FloatArray) -> FloatArray:
    rows = np.zeros((len(points), 2, 11))
    for axis in (0, 1):
        rows[:, axis, 4 * axis : 4 * axis + 3] = points
        rows[:, axis, 4 * axis + 3] = 1.0
        rows[:, axis, 8:] = -pixels[:, axis, None] * points
    system = rows.reshape(-1, 11)
    scale = np.linalg.norm(system, axis=0)  # the same solution, from a better conditioned system
    return np.linalg.lstsq(system / scale, pixels.ravel(), rcond=None)[0] / scale


def _normalisation(values: FloatArray) -> FloatArray:
    """Hartley's similarity: centroid to the origin, mean distance sqrt(dimension)."""
    dimension = values.shape[1]
    centre = values.mean(axis=0)
    scale = np.sqrt(dimension) / np.linalg.norm(values - centre, axis=1).mean()
    matrix = np.diag([scale] * dimension + [1.0])
    matrix[:dimension, dimension] = -scale * centre
    return matrix


def _apply(similarity: FloatArray, values: FloatArray) -> FloatArray:
    return values * similarity[0, 0] + similarity[:-1, -1]


def _coefficient_jacobian(coefficients: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Images ``(N, 2)`` and their derivatives ``(2N, 11)`` by the coefficients."""
    matrix = np.append(coefficients, 1.0).reshape(3, 4)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    image = homogeneous @ matrix.T
    xy = image[:, :2] / image[:, 2:]
    weighted = homogeneous / image[:, 2:]
    jacobian = np.zeros((len(points), 2, 11))
    for axis in (0, 1):
        jacobian[:, axis, 4 * axis : 4 * axis + 4] = weighted
        jacobian[:, axis, 8:] = -xy[:, axis, None] * weighted[:, :3]
    return xy, jacobian.reshape(-1, 11)


def _refine(coefficients: FloatArray, points: FloatArray, pixels: FloatArray) -> FloatArray:
    """Gauss-Newton on the reprojection error, in normalised coordinates."""
    for _ in range(_ITERATIONS):
        xy, jacobian = _coefficient_jacobian(coefficients, points)
        step = np.linalg.lstsq(jacobian, (pixels - xy).ravel(), rcond=None)[0]
        coefficients = coefficients + step
        if np.abs(step).max() < 1e-13:
            break
    return coefficients


def _covariance(coefficients: FloatArray, points: FloatArray, pixels: FloatArray) -> tuple[FloatArray, float]:
    """Covariance ``(11, 11)`` of the coefficients from the residuals, and the rms residual per axis."""
    xy, jacobian = _coefficient_jacobian(coefficients, points)
    residual = (pixels - xy).ravel()
    freedom = max(residual.size - 11, 1)
    scale = np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale))
    covariance = inverse / np.outer(scale, scale) * (residual @ residual) / freedom
    return covariance, float(np.sqrt(np.mean(residual**2)))
