"""A frame as columns, a row a point."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import FloatArray
from bscd.results import FrameResult


def frame_columns(points_px: FloatArray, frame: FrameResult) -> dict[str, NDArray[Any]]:
    """Columns ``(N,)`` by name for the requested points ``(N, 2)``."""
    count = len(points_px)
    parts: list[tuple[str, FloatArray]] = [
        ("x_px,y_px", points_px),
        ("x_mm,y_mm,z_mm", frame.xyz_mm),
        ("dx_mm,dy_mm,dz_mm", frame.displacement_mm),
        ("u_mm,v_mm,w_mm", frame.uvw_mm),
        ("exx,eyy,exy", frame.strain),
        ("e1,e2", frame.principal),
        ("sigma_x_mm,sigma_y_mm,sigma_z_mm", frame.sigma_mm),
        ("sigma_dx_mm,sigma_dy_mm,sigma_dz_mm", frame.displacement_sigma_mm),
        ("zncc", frame.zncc[:, None]),
        ("epipolar_px", frame.epipolar_px[:, None]),
    ]
    columns: dict[str, NDArray[Any]] = {
        "frame": np.full(count, frame.number),
        "time_s": np.full(count, frame.time_s),
        "pressure_kpa": np.full(count, frame.pressure_kpa),
        "point": np.arange(count),
    }
    for names, values in parts:
        columns |= dict(zip(names.split(","), values.T, strict=True))
    return columns | {"valid": frame.valid, "extrapolated": frame.extrapolated, "status": frame.status}
