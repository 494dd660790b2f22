"""The membrane frame of DESIGN section 2: from a cap fitted to the reference shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bscd.analysis.surface.outline import Outline, find_outline
from bscd.analysis.surface.round_fit import fit_round
from bscd.analysis.surface.round_surface import RoundSurface
from bscd.arrays import FloatArray
from bscd.errors import InputError

#: Towards the camera in the world frame, whose y runs away from it.
TOWARDS_CAMERA = (0.0, -1.0, 0.0)

_LEAST_POINTS = 20
#: Times that the outline is looked at again, along the normal at its own middle.
_VIEWS = 2


@dataclass(frozen=True)
class MembraneFrame:
    """Where the membrane is: ``origin_mm`` ``(3,)`` on its surface and ``axes`` ``(3, 3)``, rows x', y', z'.

    ``centre_from`` says what the origin is the centre of: ``given`` by the caller, the ``circle`` that the measured
    points' outline shows, or, where that is not round, the ``outline``'s area. ``centre_sigma_mm`` is the circle's
    standard uncertainty along the surface, else NaN: on a curved cap of radius R it tilts z' by as much over R.
    ``cap_radius_mm`` is the radius of curvature at the origin (positive when convex towards z', infinite when flat),
    ``outline_radius_mm`` the circle's radius or NaN, ``rms_mm`` the points' scatter about the cap.
    """

    origin_mm: FloatArray
    axes: FloatArray
    centre_from: Literal["given", "circle", "outline"]
    centre_sigma_mm: float
    outline_radius_mm: float
    cap_radius_mm: float
    rms_mm: float

    @classmethod
    def fit(
        cls,
        xyz_mm: FloatArray,
        *,
        towards: FloatArray | tuple[float, float, float] = TOWARDS_CAMERA,
        centre_mm: FloatArray | None = None,
        x_axis: FloatArray | tuple[float, float, float] = (1.0, 0.0, 0.0),
    ) -> MembraneFrame:
        """Fit the frame to the reference shape's points ``(N, 3)`` mm, flat or curved; rows with NaN take no part.

        The cap is the robust geometric fit of a sphere whose curvature may be 0 (`fit_round`). A sphere has no apex of
        its own: only the outline can say where its cap's centre is, or ``centre_mm`` ``(3,)``, a world point whose
        foot on the cap becomes the origin. z' is the cap's normal there. ``towards`` (a direction, world) gives z'
        its sense, ``x_axis`` (world) projects to x'.

        Raises
        ------
        InputError
            Too few points, points on a line, or directions that can not serve.
        """
        points = np.asarray(xyz_mm, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"a membrane frame is fitted to points (N, 3), not to an array of shape {points.shape}")
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < _LEAST_POINTS:
            raise InputError(f"a membrane frame needs at least {_LEAST_POINTS} points; {len(points)} are known")
        extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if extent[1] <= 1e-6 * extent[0]:
            raise InputError("the membrane's points lie on a line; give points that spread over its surface")
        fit = fit_round(points)
        kept = points[fit.weights > 0.0]
        camera, world_x = _vector(towards, "towards"), _vector(x_axis, "x_axis")
        if centre_mm is not None:
            outline = None
            cap = fit.surface.anchored_at(_vector(centre_mm, "centre_mm"))
        else:
            cap, outline = _centred(fit.surface, kept, world_x)
        normal = _towards(cap.normal, camera)
        bend = cap.curvature * float(normal @ cap.normal)
        return cls(
            cap.anchor,
            _axes(normal, world_x),
            "given" if outline is None else "circle" if outline.is_circle else "outline",
            np.nan if outline is None else outline.sigma_mm,
            np.nan if outline is None else outline.radius_mm,
            1.0 / bend if bend != 0.0 else np.inf,
            float(np.sqrt(np.mean(cap.distance(kept) ** 2))),
        )

    def points(self, xyz_mm: FloatArray) -> FloatArray:
        """World points ``(..., 3)`` mm in this frame: x', y', z'."""
        return (np.asarray(xyz_mm) - self.origin_mm) @ self.axes.T

    def vectors(self, vectors: FloatArray) -> FloatArray:
        """World vectors ``(..., 3)``, such as displacements, in this frame: u, v, w along x', y', z'."""
        return np.asarray(vectors) @ self.axes.T


def _centred(cap: RoundSurface, points_mm: FloatArray, world_x: FloatArray) -> tuple[RoundSurface, Outline]:
    """The cap anchored at the foot of its outline's middle, and the outline as seen along the normal there."""
    cap = cap.anchored_at(points_mm.mean(axis=0))
    along = _axes(cap.normal, world_x)[:2]
    outline = find_outline((points_mm - cap.anchor) @ along.T)
    for _ in range(_VIEWS):
        cap = cap.anchored_at(cap.anchor + outline.middle_mm @ along)
        along = _axes(cap.normal, world_x)[:2]
        outline = find_outline((points_mm - cap.anchor) @ along.T)
    return cap.anchored_at(cap.anchor + outline.middle_mm @ along), outline


def _vector(values: FloatArray | tuple[float, float, float], name: str) -> FloatArray:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{name} must be three finite numbers, not {values}")
    return vector


def _towards(normal: FloatArray, direction: FloatArray) -> FloatArray:
    along = float(normal @ direction)
    if not abs(along) > 1e-6 * np.linalg.norm(direction):
        raise InputError("towards must not lie in the membrane's plane; give the direction to the camera")
    return normal * np.sign(along)


def _axes(normal: FloatArray, world_x: FloatArray) -> FloatArray:
    """Rows x', y', z'."""
    x = world_x - (world_x @ normal) * normal
    length = np.linalg.norm(x)
    if not length > 1e-6 * np.linalg.norm(world_x):
        raise InputError("x_axis must not be normal to the membrane; give a direction that lies along it")
    x = x / length
    return np.stack([x, np.cross(normal, x), normal])
