"""MATLAB: a .mat file in MultiDIC's layout, for `plot3DDICPPresults` and its `anim8_DIC3DPP_*` functions.

MultiDIC (Solav et al., IEEE Access 6, 2018, https://github.com/MultiDIC/MultiDIC) keeps what its fourth step
computes in one structure, ``DIC3DPPresults``; here it is computed from the results file. Its two cameras are the
left and the right view. Indices and pixels count from 1, as MATLAB's do.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from bscd.arrays import FloatArray, IntArray
from bscd.errors import InputError
from bscd.results.export.folder import ExportProgress, exporting, frames_to_export
from bscd.results.export.rigid_motion import RigidMotion, rigid_motion
from bscd.results.export.surface import triangulate
from bscd.results.export.triangle_deformation import isotropy_index, triangle_deformation
from bscd.results.reader import ResultsFile
from bscd.results.records import FrameResult

FILE_NAME = "DIC3DPPresults_1Pairs.mat"

#: MATLAB reads no larger variable from this kind of file.
_LARGEST_BYTES = 2**31 - 1

#: float64 numbers a point and a face take in a frame of ``DIC3DPPresults``, and a face's tensors.
_NUMBERS_PER_POINT, _NUMBERS_PER_FACE, _NUMBERS_OF_TENSORS = 23, 80, 72


def export_matlab(results: ResultsFile, folder: Path, progress: ExportProgress | None = None) -> tuple[Path, ...]:
    """Write ``DIC3DPPresults_1Pairs.mat`` and return its path, alone.

    It holds ``DIC3DPPresults`` and ``bscd``, a structure with what MultiDIC has no place for: uncertainties,
    displacements in the membrane frame, status, times, pressures, parameters and where the results come from.
    The faces' tensors (``Fmat``, ``Cmat``, ``Emat``, ``emat``) are left out where one file has no room for them.

    Raises
    ------
    InputError
        The folder holds such a file already, there is nothing to export, or it is too much for one MATLAB file.
    """
    path = folder / FILE_NAME
    faces = triangulate(results.points_px)
    tensors = _tensors_fit(results, len(faces))
    with exporting(folder, [FILE_NAME]):
        frames = list(frames_to_export(results, progress))
        content = {
            "DIC3DPPresults": _dic3dpp_results(results, faces, frames, tensors),
            "bscd": _beside(results, frames),
        }
        savemat(path, content, long_field_names=True, oned_as="column")
    return (path,)


def _tensors_fit(results: ResultsFile, faces: int) -> bool:
    """Whether there is room for the faces' tensors too; raises `InputError` where there is none for the rest."""
    frame_bytes = 8 * (_NUMBERS_PER_POINT * len(results.points_px) + _NUMBERS_PER_FACE * faces)
    if len(results) * frame_bytes > _LARGEST_BYTES:
        raise InputError(
            f"{results.path} is too large for one MATLAB file ({len(results)} frames of {len(results.points_px)} "
            f"points, {_LARGEST_BYTES // frame_bytes} are possible); export csv, or measure fewer points or frames"
        )
    return len(results) * (frame_bytes + 8 * _NUMBERS_OF_TENSORS * faces) <= _LARGEST_BYTES


def _dic3dpp_results(results: ResultsFile, faces: IntArray, frames: list[FrameResult], tensors: bool) -> dict[str, Any]:
    """The structure of MultiDIC's fourth step, fields and shapes as there."""
    reference_mm = reference_shape(frames)
    points_mm = [frame.xyz_mm for frame in frames]
    motions = [rigid_motion(points, reference_mm) for points in points_mm]
    unmoved_mm = [motion.apply(points) for motion, points in zip(motions, points_mm, strict=True)]
    correlation = [ncorr_coefficient(frame.zncc) for frame in frames]
    one_pair = np.ones((len(faces), 1))
    return {
        "Faces": faces + 1.0,
        "Points3D": _cells(points_mm),
        "corrComb": _cells(correlation),
        "FaceColors": np.full((len(faces), 1), np.nan),  # grey values of the image, which results do not hold
        "FacePairInds": one_pair,
        "pairIndices": np.array([[1.0, 2.0]]),
        "PointPairInds": np.ones((len(results.points_px), 1)),
        "DIC2Dinfo": _cells([_matches(faces, frames, correlation)]),
        "Points3D_ARBM": _row(unmoved_mm),
        "Disp": _displacements([frame.displacement_mm for frame in frames], [p - reference_mm for p in unmoved_mm]),
        "FaceCentroids": _row([points[faces].mean(axis=1) for points in points_mm]),
        "FaceCentroids_ARBM": _row([points[faces].mean(axis=1) for points in unmoved_mm]),
        "FaceCorrComb": _row([c[faces, 0].max(axis=1, keepdims=True) for c in correlation]),
        "FaceIsoInd": _row([isotropy_index(faces, points)[:, None] for points in points_mm]),
        "RBM": _motions(motions),
        "Deform": _deformation(faces, reference_mm, points_mm, tensors),
        "Deform_ARBM": _deformation(faces, reference_mm, unmoved_mm, tensors),
    }


def reference_shape(frames: list[FrameResult]) -> FloatArray:
    """Where each point was in the reference ``(N, 3)``: position less displacement, where a frame knows both."""
    shape_mm = np.full_like(frames[0].xyz_mm, np.nan)
    for frame in frames:
        found_mm = frame.xyz_mm - frame.displacement_mm
        shape_mm = np.where(np.isnan(shape_mm).any(axis=1, keepdims=True), found_mm, shape_mm)
    return shape_mm


def ncorr_coefficient(zncc: FloatArray) -> FloatArray:
    """Ncorr's correlation coefficient ``(N, 1)``, the ZNSSD: 0 is a perfect match, 2 (1 - ZNCC)."""
    return 2.0 * (1.0 - zncc.astype(np.float64))[:, None]


def _matches(faces: IntArray, frames: list[FrameResult], correlation: list[FloatArray]) -> dict[str, Any]:
    """The pair's matches as MultiDIC's second step keeps them: all frames of the left view, then of the right."""
    points_px = [frame.left_px + 1.0 for frame in frames] + [frame.right_px + 1.0 for frame in frames]
    return {
        "nCamRef": 1.0,
        "nCamDef": 2.0,
        "nImages": float(len(frames)),
        "ImPaths": _cells([""] * len(points_px)),
        "Points": _cells(points_px),
        "CorCoeffVec": _cells(correlation * 2),
        "Faces": faces + 1.0,
        "FaceColors": np.full((len(faces), 1), np.nan),
    }


def _displacements(moved_mm: list[FloatArray], unmoved_mm: list[FloatArray]) -> dict[str, Any]:
    def lengths(vectors: list[FloatArray]) -> NDArray[np.object_]:
        return _row([np.linalg.norm(vector, axis=1)[:, None] for vector in vectors])

    return {
        "DispVec": _row(moved_mm),
        "DispMgn": lengths(moved_mm),
        "DispVec_ARBM": _row(unmoved_mm),
        "DispMgn_ARBM": lengths(unmoved_mm),
    }


def _motions(motions: list[RigidMotion]) -> dict[str, Any]:
    return {
        "RotMat": _row([motion.rotation for motion in motions]),
        "TransVec": _row([motion.translation_mm[:, None] for motion in motions]),
    }


def _deformation(
    faces: IntArray, reference_mm: FloatArray, points_mm: list[FloatArray], tensors: bool
) -> dict[str, Any]:
    found = [triangle_deformation(faces, reference_mm, points, tensors=tensors) for points in points_mm]
    # a tensor a face is (3, 3, M) there
    return {
        name: _cells([np.moveaxis(v[name], 0, -1) if v[name].ndim == 3 else v[name] for v in found])
        for name in found[0]
    }


def _beside(results: ResultsFile, frames: list[FrameResult]) -> dict[str, Any]:
    """What MultiDIC has no place for."""
    header = results.header
    return {
        "title": header.title,
        "uuid": header.uuid,
        "sha256": results.checksum,
        "run_file": header.run.file_name,
        "run_uuid": header.run.uuid,
        "run_sha256": header.run.checksum,
        "calibration_file": header.calibration.file_name,
        "calibration_uuid": header.calibration.uuid,
        "calibration_sha256": header.calibration.checksum,
        "program_version": header.program_version,
        "parameters_json": header.parameters_json(),
        "points_px": results.points_px + 1.0,
        "frame_number": np.array([[float(frame.number)] for frame in frames]),
        "time_s": np.array([[frame.time_s] for frame in frames]),
        "pressure_kpa": np.array([[frame.pressure_kpa] for frame in frames]),
        "uvw_mm": _row([frame.uvw_mm for frame in frames]),
        "strain": _row([frame.strain for frame in frames]),
        "sigma_mm": _row([frame.sigma_mm for frame in frames]),
        "displacement_sigma_mm": _row([frame.displacement_sigma_mm for frame in frames]),
        "epipolar_px": _row([frame.epipolar_px[:, None] for frame in frames]),
        "status": _row([frame.status[:, None] for frame in frames]),
        "extrapolated": _row([frame.extrapolated[:, None].astype(np.uint8) for frame in frames]),
        "status_codes": np.array([[float(code)] for code in header.status_names]),
        "status_names": _cells(list(header.status_names.values())),
    }


def _cells(values: list[Any]) -> NDArray[np.object_]:
    """A cell array ``(n, 1)``."""
    cells = np.empty((len(values), 1), object)
    for k, value in enumerate(values):
        cells[k, 0] = value
    return cells


def _row(values: list[Any]) -> NDArray[np.object_]:
    """A cell array ``(1, n)``."""
    return _cells(values).T
