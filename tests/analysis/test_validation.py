"""Figures of a validation, against hand-made errors."""

import numpy as np
import pytest

from bscd.analysis.validation import ErrorFigure, Validation, compare_variants, validate
from bscd.calibration import CalibrationChoices, calibrate
from tests.calibration.exact_rig import ExactRig


def made(errors, inside):
    expected = np.column_stack([np.zeros(len(errors)), np.linspace(0.0, 9.0, len(errors)), np.zeros(len(errors))])
    moved = expected + np.outer(errors, [0.6, 0.0, 0.8])
    empty = np.zeros((len(errors), 2))
    return Validation(
        np.arange(len(errors)),
        expected[:, 1],
        np.ones(len(errors), bool),
        empty,
        empty,
        expected,
        moved * 1.0 + [0.0, 3.0, 4.0],
        np.where(np.asarray(inside)[:, None], moved, np.nan),
        np.ones((len(errors), 3)),
        np.zeros(len(errors)),
        np.asarray(inside),
    )


def test_figures_count_the_points_inside():
    found = made([1.0, 2.0, 3.0, 100.0], [True, True, True, False])
    assert found.figure() == ErrorFigure(pytest.approx(2.0), pytest.approx(np.std([1, 2, 3])), 3)
    assert found.figure("uncorrected").count == 3
    assert np.isnan(found.error_mm()[3])
    assert found.figure(against="truth").count == 0


def test_thirds_split_the_depth_of_the_points_inside():
    found = made(np.ones(10), np.ones(10, bool))
    thirds = [found.depth_third(third) for third in range(3)]
    assert np.array_equal(np.sum(thirds, axis=0), np.ones(10))
    assert [int(third.sum()) for third in thirds] == [3, 3, 4]


def test_expected_positions_follow_the_stages():
    """Turned by 3 degrees and between the positions, the dots are where the reference's axes put them."""
    rig = ExactRig(noise_px=0.0)
    calibration = calibrate(rig.reference(), rig.bsc(), rig.target, (1280, 1024), CalibrationChoices())
    views = rig.second_acquisition(shift_mm=(0.0, 0.0, 0.0))
    found = validate(calibration, views, rig.target)
    true = np.stack([rig.dots_mm(np.array([i]), 3.0, y)[0] for i, y in zip(found.index, found.y_mm, strict=True)])
    assert np.abs(found.expected_mm - true).max() < 1e-5
    assert found.figure("uncorrected").mean_mm > 0.1
    assert found.figure("corrected").mean_mm < 1e-3
    variants = compare_variants(calibration, views, rig.target)
    assert set(variants) == {(s, i) for s in ("projection", "smallest") for i in ("smooth", "linear")}
    assert all(variant.figure().mean_mm < 5e-3 for variant in variants.values())
