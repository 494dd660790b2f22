"""Small results with known content, made from a seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from bscd.results import FrameResult, MembraneFrame, Origin, ResultsHeader, ResultsWriter

START = datetime(2026, 3, 1, 12, 0, 0, tzinfo=UTC)
STATUS_NAMES = {0: "valid", 1: "correlation too low", 2: "outside the calibrated hull", 7: "object gone"}
STEP_PX = 10.0

#: Fields of a frame that the file keeps as float32.
SINGLE = ("strain", "principal", "principal_direction", "sigma_mm", "displacement_sigma_mm", "zncc", "epipolar_px")


def grid_px(columns: int = 5, rows: int = 4) -> np.ndarray:
    """Points of a regular grid ``(rows * columns, 2)``."""
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.stack([column.ravel(), row.ravel()], axis=1) * STEP_PX + (103.0, 57.0)


def header(**changes) -> ResultsHeader:
    axes = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    known = {
        "title": "Inflation of the membrane, été",
        "run": Origin("run.h5", "11111111-2222-4333-8444-555555555555", "ab" * 32),
        "calibration": Origin("calibration.h5", "", "cd" * 32),
        "points_px": grid_px(),
        "status_names": STATUS_NAMES,
        "reference_frames": (3, 4),
        "membrane": MembraneFrame(np.array([0.5, 1.0, -2.0]), axes),
        "parameters": {"subset_px": 21, "step_px": 10.0, "extrapolate": False, "order": "affine", "radius_mm": np.nan},
    }
    return ResultsHeader(**(known | changes))


def frames(count: int, points_px: np.ndarray | None = None, first: int = 3, seed: int = 1) -> Iterator[FrameResult]:
    """A cap that rises; a few points are lost, in the last frame but one all of them."""
    points_px = grid_px() if points_px is None else points_px
    rng = np.random.default_rng(seed)
    shape_mm = reference_mm(points_px)
    for k in range(count):
        n = len(points_px)
        moved_mm = np.stack([0.01 * k * shape_mm[:, 0], -0.3 * k * np.ones(n), 0.02 * k * shape_mm[:, 2]], axis=1)
        status = rng.choice([0, 0, 0, 0, 0, 1, 2], n).astype(np.uint8)
        if count > 2 and k == count - 2:
            status[:] = 7
        lost = status != 0

        def some(width, dtype=np.float64, lost=lost, n=n):
            values = rng.normal(size=(n, width) if width else n).astype(dtype)
            values[lost] = np.nan
            return values

        xyz_mm, moved_mm = (
            np.where(lost[:, None], np.nan, shape_mm + moved_mm),
            np.where(lost[:, None], np.nan, moved_mm),
        )
        yield FrameResult(
            number=first + k,
            time_s=k / 11,
            pressure_kpa=0.05 + 0.3 * k,
            xyz_mm=xyz_mm,
            displacement_mm=moved_mm,
            uvw_mm=some(3),
            strain=some(3, np.float32),
            principal=some(2, np.float32),
            principal_direction=some(3, np.float32),
            sigma_mm=np.abs(some(3, np.float32)),
            displacement_sigma_mm=np.abs(some(3, np.float32)),
            zncc=(0.99 + 0.001 * some(0)).astype(np.float32),
            epipolar_px=some(0, np.float32),
            status=status,
            left_px=some(2),
            right_px=some(2),
        )


def with_extrapolated(frame: FrameResult, point: int) -> FrameResult:
    """The frame with a point outside the calibrated hull that has a position all the same."""
    status, xyz_mm = frame.status.copy(), frame.xyz_mm.copy()
    status[point], xyz_mm[point] = 2, (11.0, -2.0, 7.0)
    return replace(frame, status=status, xyz_mm=xyz_mm)


def reference_mm(points_px: np.ndarray) -> np.ndarray:
    """A cap above the pixel grid, facing the camera (which looks along y)."""
    x_mm, z_mm = 0.05 * (points_px[:, 0] - 123.0), -0.05 * (points_px[:, 1] - 72.0)
    return np.stack([x_mm, (x_mm**2 + z_mm**2) / 60.0, z_mm], axis=1)


def write(path, count=5, head=None, measured=None, **settings):
    head = head or header()
    measured = frames(count, head.points_px) if measured is None else measured
    with ResultsWriter(path, head, now=lambda: START, **settings) as results:
        for frame in measured:
            results.append(frame)
    return path


def same(one: FrameResult, other: FrameResult) -> bool:
    """Whether two frames are the same bit for bit, types included; NaN equals NaN."""
    for name in FrameResult.__slots__:
        a, b = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
        if a.dtype != b.dtype or not np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
            return False
    return True
