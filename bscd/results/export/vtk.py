"""ParaView: a VTU file a frame, and a PVD file that strings them together in time."""

from __future__ import annotations

import xml.etree.ElementTree as ET  # written only, never parsed
from collections.abc import Sequence
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import ArrayLike

from bscd.arrays import FloatArray, IntArray
from bscd.results.export.folder import ExportProgress, exporting, frames_to_export
from bscd.results.export.surface import triangulate
from bscd.results.reader import ResultsFile
from bscd.results.records import FrameResult


def export_vtk(results: ResultsFile, folder: Path, progress: ExportProgress | None = None) -> tuple[Path, ...]:
    """Write ``frame_0000.vtu``, ... and ``<name of the results>.pvd``, and return their paths, the PVD last.

    Open the PVD. Its times are seconds where every frame has one and they increase, else frame numbers.

    Raises
    ------
    InputError
        The folder holds such files already, or there is nothing to export.
    """
    made, times = [], []
    triangles = triangulate(results.points_px)
    with exporting(folder, ["frame_*.vtu", "*.pvd"]):
        for frame in frames_to_export(results, progress):
            path = folder / f"frame_{frame.number:04d}.vtu"
            frame_mesh(results.points_px, triangles, frame).write(path, file_format="vtu")
            made.append(path)
            times.append(frame.time_s)
        collection = folder / f"{results.path.stem}.pvd"
        increasing = bool(np.isfinite(times).all() and (np.diff(times) > 0.0).all())
        numbers = results.frame_numbers()[: len(made)].tolist()
        _write_collection(collection, [path.name for path in made], times if increasing else numbers)
    return (*made, collection)


def frame_mesh(points_px: FloatArray, triangles: IntArray, frame: FrameResult) -> meshio.Mesh:
    """One frame's surface: the points whose position is known and the triangles between them.

    Points without a triangle are vertices. ``point`` is a point's place among the requested ones.
    """
    known = np.all(np.isfinite(frame.xyz_mm), axis=1)
    place = np.cumsum(known) - 1
    surface = triangles[known[triangles].all(axis=1)]
    alone = np.setdiff1d(np.flatnonzero(known), surface)[:, None]
    cells: list[tuple[str, ArrayLike] | meshio.CellBlock] = [
        (kind, place[corners]) for kind, corners in (("triangle", surface), ("vertex", alone)) if len(corners)
    ]
    values = {
        "point": np.arange(len(known), dtype=np.int32),
        "valid": frame.valid.astype(np.uint8),
        "extrapolated": frame.extrapolated.astype(np.uint8),
        "status": frame.status,
        "displacement_mm": frame.displacement_mm,
        "uvw_mm": frame.uvw_mm,
        "exx": frame.strain[:, 0],
        "eyy": frame.strain[:, 1],
        "exy": frame.strain[:, 2],
        "e1": frame.principal[:, 0],
        "e2": frame.principal[:, 1],
        "e1_direction": frame.principal_direction,
        "sigma_mm": frame.sigma_mm,
        "displacement_sigma_mm": frame.displacement_sigma_mm,
        "zncc": frame.zncc,
        "epipolar_px": frame.epipolar_px,
        "x_px": points_px[:, 0],
        "y_px": points_px[:, 1],
    }
    return meshio.Mesh(
        frame.xyz_mm[known],
        cells or [("triangle", surface)],
        point_data={name: np.ascontiguousarray(value[known]) for name, value in values.items()},
    )


def _write_collection(path: Path, names: Sequence[str], times: Sequence[float]) -> None:
    """PVD: https://www.paraview.org/Wiki/ParaView/Data_formats#PVD_File_Format."""
    root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ET.SubElement(root, "Collection")
    for name, time in zip(names, times, strict=True):
        ET.SubElement(collection, "DataSet", timestep=repr(time), group="", part="0", file=name)
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
