"""pyvale (C++ under Python): ZNSSD, affine, cubic B-spline, its default Gaussian prefilter (5 px, sigma 1).

The reliability-guided scan from one seed in the middle is the faster of its two, at the same accuracy; it ends an
iteration at its default precision of 0.001. It returns results through a file only, so writing that is timed,
reading it is not.
"""

from __future__ import annotations

import importlib.util
import shutil
import sys
import tempfile
import types
from pathlib import Path
from typing import Any

import numpy as np


def _import_dic() -> types.ModuleType:
    """``pyvale.dic`` without the rest of pyvale, which would load VTK and Qt."""
    spec = importlib.util.find_spec("pyvale")
    if spec is None or spec.submodule_search_locations is None:
        raise ImportError("pyvale is not installed")
    package = types.ModuleType("pyvale")
    package.__path__ = list(spec.submodule_search_locations)
    sys.modules["pyvale"] = package
    return importlib.import_module("pyvale.dic")


DIC = _import_dic()
SHAPES = {"affine": "AFFINE", "quadratic": "QUAD", "translation": "RIGID"}


def correlate(
    reference: np.ndarray, current: np.ndarray, points: np.ndarray, job: dict[str, Any], threads: int
) -> Path:
    """Correlate the whole image at the step; its grid starts where the first subset fits, as ``points`` do."""
    folder = Path(tempfile.mkdtemp())
    rows, columns = reference.shape
    DIC.calculate_2d(
        reference,
        current,
        np.ones(reference.shape, dtype=bool),
        [(columns // 2, rows // 2)],
        subset_size=job["subset_px"],
        subset_step=job["step_px"],
        correlation_criteria="ZNSSD",
        shape_function=SHAPES[job["options"].get("shape", "affine")],
        interpolation_routine="BSPLINE",
        method="SINGLEWINDOW_RG",
        num_threads=threads,
        output_basepath=folder,
        output_binary=True,
        output_below_threshold=True,
        print_level=0,
    )
    return folder


def answer(raw: Path, points: np.ndarray, job: dict[str, Any]) -> dict[str, np.ndarray]:
    results = DIC.import_2d([next(raw.iterdir())], ",", binary=True, layout="column", print_level=0)
    shutil.rmtree(raw)
    where = {(column, row): i for i, (column, row) in enumerate(points)}
    displacement, valid = np.full((len(points), 2), np.nan), np.zeros(len(points), dtype=bool)
    # 0.9 is the ZNCC below which it would by default leave a point out
    good = np.ravel(results.cost) >= 0.9
    for k, (column, row) in enumerate(zip(results.ss_x, results.ss_y, strict=True)):
        i = where.get((column, row))
        if i is not None and good[k]:
            displacement[i] = np.ravel(results.u_px)[k], np.ravel(results.v_px)[k]
            valid[i] = True
    return {"displacement_px": displacement, "valid": valid}
