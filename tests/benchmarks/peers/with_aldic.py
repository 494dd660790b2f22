"""pyALDIC (al-dic, numba) in its local mode: ZNSSD, affine, bicubic (Catmull-Rom) interpolation, its tolerance 0.01.

Its initial guess is the NCC search in a 41x41 window, or where points move further its propagation from a seed in
the middle, which finds more of them. Its ``winsize`` 20 is 21x21 pixels. Its configuration check allows steps that
are powers of two only; the pipeline itself takes 5. Points that fail it fills from their neighbours without saying
which, so all of its points count as valid. Its pipeline is timed as it comes, mesh and composition included.
"""

from __future__ import annotations

import os
import sys
import warnings
from typing import Any

import numpy as np

# before the imports: the initial search starts as many threads as there are processors
os.cpu_count = lambda: int(sys.argv[2])

import cv2  # noqa: E402
from al_dic import DICPara, run_aldic  # noqa: E402
from al_dic.core.data_structures import GridxyROIRange, PipelineResult  # noqa: E402
from al_dic.solver.seed_propagation import Seed, SeedSet  # noqa: E402

SEARCH_PX = 20


def correlate(
    reference: np.ndarray, current: np.ndarray, points: np.ndarray, job: dict[str, Any], threads: int
) -> PipelineResult:
    """Correlate on the grid of ``points``, which its region of interest gives."""
    cv2.setNumThreads(threads)
    (left, top), (right, bottom) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    down = (bottom - top) // job["step_px"] + 1
    middle = len(points) // down // 2 * down + down // 2
    far = job["largest_px"] > SEARCH_PX
    options = DICPara(
        winsize=job["subset_px"] - 1,
        winstepsize=job["step_px"],
        winsize_min=job["step_px"],
        gridxy_roi_range=GridxyROIRange((left, right), (top, bottom)),
        img_size=reference.shape,
        use_global_step=False,
        size_of_fft_search_region=SEARCH_PX,
        init_guess_mode="seed_propagation" if far else "fft",
        seed_set=SeedSet(seeds=(Seed(middle, 0),)) if far else None,
        reference_mode="accumulative",
        show_plots=False,
    )
    everywhere = np.ones(reference.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return run_aldic(
            options,
            [reference / 255.0, current / 255.0],
            [everywhere, everywhere],
            compute_strain=False,
            progress_fn=lambda *_: None,
        )


def answer(raw: PipelineResult, points: np.ndarray, job: dict[str, Any]) -> dict[str, np.ndarray]:
    nodes = np.rint(raw.dic_mesh.coordinates_fem).astype(np.int64)
    found = raw.result_disp[0].U.reshape(-1, 2)
    order = np.lexsort(nodes.T)
    same = np.lexsort(points.T)
    if not np.array_equal(nodes[order], points[same]):
        raise ValueError(f"pyALDIC solved {len(nodes)} points, other than the {len(points)} of the grid")
    displacement = np.empty((len(points), 2))
    displacement[same] = found[order]
    return {"displacement_px": displacement, "valid": ~np.isnan(displacement).any(axis=1)}
