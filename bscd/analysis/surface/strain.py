"""Green-Lagrange strain of a tracked surface, all frames at once."""

from __future__ import annotations

import numpy as np

from bscd.analysis.surface.frame import MembraneFrame
from bscd.analysis.surface.strain_gauge import StrainGauge, SurfaceStrain, matching
from bscd.analysis.surface.strain_settings import StrainSettings, StrainWindow
from bscd.arrays import FloatArray
from bscd.errors import InputError


def surface_strain(
    points_px: FloatArray,
    reference_mm: FloatArray,
    current_mm: FloatArray,
    *,
    sigma_mm: FloatArray | None = None,
    reference_sigma_mm: FloatArray | None = None,
    settings: StrainSettings | None = None,
    frame: MembraneFrame | None = None,
) -> tuple[SurfaceStrain, StrainWindow]:
    """Strain of all frames ``(T, N, 3)`` mm at once, and the window that measured it; `StrainGauge` frame by frame.

    Raises `InputError` as `StrainGauge` and `StrainGauge.measure` do.
    """
    current_mm = np.asarray(current_mm, dtype=np.float64)
    if current_mm.ndim != 3:
        raise InputError(f"frames of points have shape (T, N, 3), not {current_mm.shape}")
    gauge = StrainGauge(points_px, reference_mm, settings=settings, reference_sigma_mm=reference_sigma_mm, frame=frame)
    sigmas = [None] * len(current_mm) if sigma_mm is None else list(matching(current_mm, sigma_mm, "sigma_mm"))
    frames = [gauge.measure(*state) for state in zip(current_mm, sigmas, strict=True)]
    fields = ("strain", "principal", "angle_deg", "sigma", "status")
    return SurfaceStrain(*(np.stack([getattr(one, name) for one in frames]) for name in fields)), gauge.window
