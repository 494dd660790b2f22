"""The data of a report, from exact projections by the twin's ray trace plus noise."""

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

import numpy as np

from bscd.analysis.report import ReportData, RunOrigin
from bscd.analysis.validation import ErrorFigure, compare_variants, validate
from bscd.calibration import calibrate
from tests.calibration.exact_rig import ExactRig

SIZE = (1280, 1024)
SECOND = {"shift_mm": (0.0, 0.0, 0.0), "rotation_deg": 2.0, "y_mm": (-13, -5, 3, 11)}


def with_truth(rig, validation, rotation_deg):
    truth = np.empty_like(validation.expected_mm)
    for y in np.unique(validation.y_mm):
        here = validation.y_mm == y
        truth[here] = rig.dots_mm(validation.index[here], rotation_deg, y)
    return replace(validation, truth_mm=truth, floor_mm=rig.floor_mm(validation.left_px, validation.right_px))


@cache
def report_data(noise_px=0.01, positions=(-8, -4, 0, 4, 8), seed=4):
    rig = ExactRig(noise_px, seed=seed)
    reference = rig.reference(positions=positions)
    calibration = calibrate(reference, rig.bsc(positions=positions), rig.target, SIZE, jack_mm=70.0)
    again = [rig.view(camera, "corner", 0) for camera in ("left", "right")]
    between = rig.second_acquisition(**SECOND)
    figures = calibration.figures
    return ReportData(
        title="Exact rig, a test",
        started=datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC),
        duration_s=83.4,
        calibration=calibration,
        target=rig.target,
        image_size_px=SIZE,
        pos0=with_truth(rig, validate(calibration, again, rig.target), 45.0),
        volume=with_truth(rig, validate(calibration, between, rig.target), SECOND["rotation_deg"]),
        variants=compare_variants(calibration, between, rig.target),
        standard_stereo=ErrorFigure(
            figures["standard_stereo_error_mean_mm"], figures["standard_stereo_error_std_mm"], 207 * len(positions)
        ),
        summary={"reference": {"mean": 0.0045, "std": None}},
        config_text='[target]\ncolumns = 9\nname = "<&>"\n',
        runs=(RunOrigin("reference.h5", "0b1e", "aa" * 32), RunOrigin("bsc.h5", "77f2", "bb" * 32)),
        warnings=("POS.+3: 2 dots <hidden> by glare",),
        examples={"Corner at POS.0 through the biprism": _image()},
        reference_views=tuple(reference),
    )


def _image():
    row, column = np.mgrid[:1024, :1280]
    return (120 + 60 * np.sin(row / 40) * np.cos(column / 30)).astype(np.uint8)
