"""The least-squares adjustment behind `bscd.calibration.lattice`: residuals, exact derivatives, damped steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bscd.arrays import AnalyticArray, BoolArray, FloatArray
from bscd.calibration.lens import CAMERA_PARAMETERS, project_lens, rotation_matrix
from bscd.errors import InputError

MOTION_PARAMETERS = 8
"""Rotation vector (rad) and translation (mm) of the face pose, two angles of the direction."""

_ITERATIONS = 60
_CONVERGED_SIGMA = 1e-4  # no predicted residual moves by more, in units of its sigma
_PRINCIPAL_POINT_PRIOR = 0.1  # of the image's width: a long lens hardly determines it
_LENS_PRIORS = {4: 20.0, 5: 2000.0, 6: 0.3, 7: 0.3}  # k1, k2, p1, p2: far beyond any lens worth using
_COMPLEX_STEP = 1e-30


@dataclass(frozen=True)
class Seen:
    """All observations of one camera: corner-pose points ``(N, 3)``, whether in the face pose, y, image, sigma."""

    points: FloatArray
    face: BoolArray
    y_mm: FloatArray
    xy: FloatArray
    sigma: FloatArray


@dataclass(frozen=True)
class Solved:
    """Motion ``(8,)``, direction ``(3,)``, cameras ``(14,)`` each, the covariance of all, rms residual per axis."""

    motion: FloatArray
    direction: FloatArray
    cameras: Mapping[str, FloatArray]
    covariance: FloatArray
    rms_px: Mapping[str, float]


@dataclass(frozen=True)
class Adjustment:
    """Cameras ``seen`` together with the motion of what they saw, near the direction ``about``.

    ``image_size_px`` are (width, height) of their images.
    """

    seen: Mapping[str, Seen]
    about: FloatArray
    image_size_px: Mapping[str, tuple[int, int]]

    def solve(self, motion: FloatArray, cameras: Mapping[str, FloatArray]) -> Solved:
        """Minimise the weighted residuals from a start. Raises `InputError` when it does not converge."""
        parameters, covariance = _levenberg_marquardt(
            self._linearise, np.concatenate([motion, *(cameras[name] for name in self.seen)])
        )
        motion, blocks = self._split(parameters)
        rms = {name: float(np.sqrt(np.mean(self._misses(motion, blocks[name], name) ** 2))) for name in self.seen}
        return Solved(motion, np.real(direction(motion[6:8], self.about)), blocks, covariance, rms)

    def _split(self, parameters: FloatArray) -> tuple[FloatArray, dict[str, FloatArray]]:
        cameras = parameters[MOTION_PARAMETERS:].reshape(-1, CAMERA_PARAMETERS)
        return parameters[:MOTION_PARAMETERS], dict(zip(self.seen, cameras, strict=True))

    def _misses(self, motion: FloatArray, camera: FloatArray, name: str) -> FloatArray:
        one = self.seen[name]
        image = project_lens(camera, move(motion, self.about, one.points, one.face, one.y_mm))
        return np.real(one.xy - image)

    def _linearise(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weighted residuals ``(M,)`` and the derivatives ``(M, P)`` of the images, priors last."""
        motion, blocks = self._split(parameters)
        residuals, designs = [], []
        for place, (name, camera) in enumerate(blocks.items()):
            weight = 1.0 / self.seen[name].sigma[:, None]
            begin = MOTION_PARAMETERS + place * CAMERA_PARAMETERS
            design = np.zeros((len(weight), 2, parameters.size))
            by_motion, by_camera = self._slopes(motion, camera, name)
            design[:, :, :MOTION_PARAMETERS] = by_motion
            design[:, :, begin : begin + CAMERA_PARAMETERS] = by_camera
            residuals.append((self._misses(motion, camera, name) * weight).ravel())
            designs.append((design * weight[:, :, None]).reshape(-1, parameters.size))
            for parameter, (value, sigma) in self._priors(name).items():
                residuals.append(np.array([(value - camera[parameter]) / sigma]))
                designs.append(np.eye(1, parameters.size, begin + parameter) / sigma)
        return np.concatenate(residuals), np.concatenate(designs)

    def _slopes(self, motion: FloatArray, camera: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the images by motion ``(N, 2, 8)`` and camera ``(N, 2, 14)``."""
        one = self.seen[name]
        points = np.real(move(motion, self.about, one.points, one.face, one.y_mm))
        by_point = np.stack(
            [complex_slope(lambda values: project_lens(camera, values), points, axis) for axis in np.eye(3)], axis=-1
        )
        moved = np.stack(
            [
                complex_slope(lambda values: move(values, self.about, one.points, one.face, one.y_mm), motion, unit)
                for unit in np.eye(MOTION_PARAMETERS)
            ],
            axis=-1,
        )
        by_camera = [
            complex_slope(lambda values: project_lens(values, points), camera, unit)
            for unit in np.eye(CAMERA_PARAMETERS)
        ]
        return by_point @ moved, np.stack(by_camera, axis=-1)

    def _priors(self, name: str) -> dict[int, tuple[float, float]]:
        width, height = self.image_size_px[name]
        sigma = _PRINCIPAL_POINT_PRIOR * width
        centre = {2: ((width - 1) / 2.0, sigma), 3: ((height - 1) / 2.0, sigma)}
        return centre | {place: (0.0, allowed) for place, allowed in _LENS_PRIORS.items()}


def direction(angles: AnalyticArray, about: FloatArray) -> AnalyticArray:
    """Unit vector ``(3,)`` that two small angles ``(2,)`` tilt away from ``about``."""
    tilted = about + angles @ np.linalg.svd(about[None])[2][1:]
    return tilted / np.sqrt(np.sum(tilted * tilted))


def move(
    motion: AnalyticArray, about: FloatArray, points: FloatArray, face: BoolArray | bool, y_mm: FloatArray | float
) -> AnalyticArray:
    """Corner-pose points ``(N, 3)`` moved to the face pose where ``face``, then along the direction by ``y_mm``."""
    turned = points @ rotation_matrix(motion[:3]).T + motion[3:6]
    placed = np.where(np.broadcast_to(face, len(points))[:, None], turned, points)
    return placed + np.multiply.outer(np.broadcast_to(y_mm, len(points)), direction(motion[6:8], about))


def complex_slope(function: Callable[[AnalyticArray], AnalyticArray], at: FloatArray, along: FloatArray) -> FloatArray:
    """Derivative of an analytic function along a vector, exact to rounding (Squire & Trapp 1998)."""
    return np.imag(function(at + 1j * _COMPLEX_STEP * along)) / _COMPLEX_STEP


def _levenberg_marquardt(
    linearise: Callable[[FloatArray], tuple[FloatArray, FloatArray]], parameters: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(parameters, covariance) that minimise the weighted residuals."""
    residual, design = linearise(parameters)
    damping = 1e-6
    for _ in range(_ITERATIONS):
        scale = np.linalg.norm(design, axis=0)
        normal = (design / scale).T @ (design / scale)
        step = np.linalg.solve(normal + damping * np.eye(len(normal)), (design / scale).T @ residual) / scale
        trial_residual, trial_design = linearise(parameters + step)
        if trial_residual @ trial_residual > residual @ residual * (1.0 + 1e-12):
            damping = max(damping, 1e-8) * 10.0
            continue
        small = np.abs(design @ step).max() < _CONVERGED_SIGMA
        parameters, residual, design, damping = parameters + step, trial_residual, trial_design, damping / 10.0
        if small:
            variance = max(residual @ residual / max(residual.size - step.size, 1), 1e-30)
            return parameters, np.linalg.inv(normal) / np.outer(scale, scale) * variance
    raise InputError("reference: the adjustment of both cameras does not converge; check the dots' labels")
