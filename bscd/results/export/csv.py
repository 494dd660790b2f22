"""Spreadsheets: a CSV file a frame, a row a requested point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import FloatArray
from bscd.results.export.folder import ExportProgress, exporting, frames_to_export
from bscd.results.reader import ResultsFile
from bscd.results.records import FrameResult

COLUMNS = (
    "x_px,y_px,x_mm,y_mm,z_mm,dx_mm,dy_mm,dz_mm,u_mm,v_mm,w_mm,exx,eyy,exy,e1,e2,"
    "sigma_x_mm,sigma_y_mm,sigma_z_mm,zncc,epipolar_px,valid"
)


def export_csv(results: ResultsFile, folder: Path, progress: ExportProgress | None = None) -> tuple[Path, ...]:
    """Write ``frame_0000.csv``, ... (the frame's number as recorded) and return their paths.

    Every requested point has its row in every frame; what is not known is empty. Numbers have the digits that
    give back exactly what the results file holds.

    Raises
    ------
    InputError
        The folder holds such files already, or there is nothing to export.
    """
    made = []
    with exporting(folder, ["frame_*.csv"]):
        for frame in frames_to_export(results, progress):
            path = folder / f"frame_{frame.number:04d}.csv"
            path.write_text(csv_text(results.points_px, frame), encoding="ascii")
            made.append(path)
    return tuple(made)


def csv_text(points_px: FloatArray, frame: FrameResult) -> str:
    """One frame as CSV, for the requested points ``(N, 2)``."""
    measured = (
        frame.xyz_mm,
        frame.displacement_mm,
        frame.uvw_mm,
        frame.strain,
        frame.principal,
        frame.sigma_mm,
        frame.zncc,
        frame.epipolar_px,
    )
    valid = frame.valid.astype(np.uint8).astype(np.str_)[:, None]
    cells = np.hstack([_cells(points_px), *(_cells(values) for values in measured), valid])
    return "\n".join([COLUMNS, *(",".join(row) for row in cells.tolist()), ""])


def _cells(values: FloatArray) -> NDArray[np.str_]:
    """Numbers as the shortest text that reads back the same, NaN as nothing ``(N, columns)``."""
    values = values.reshape(len(values), -1)
    return np.where(np.isnan(values), "", values.astype(np.str_))
