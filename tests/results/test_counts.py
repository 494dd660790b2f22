"""How many points are valid, extrapolated and lost."""

from dataclasses import replace

import numpy as np

from bscd.results import FrameResult, count_points
from tests.results.measured import STATUS_NAMES

KNOWN, UNKNOWN = (1.0, 2.0, 3.0), (np.nan,) * 3


def frame(*points):
    """Points as (status, position)."""
    status = np.array([code for code, _ in points], np.uint8)
    return replace(FrameResult.unknown(0, len(points), 0), status=status, xyz_mm=np.array([xyz for _, xyz in points]))


def test_every_point_counts_once():
    frames = [
        frame((0, KNOWN), (0, KNOWN), (2, KNOWN), (1, UNKNOWN)),
        frame((0, KNOWN), (7, UNKNOWN), (2, UNKNOWN), (7, UNKNOWN)),
    ]
    counts = count_points(frames)
    assert (counts.valid, counts.extrapolated, counts.lost) == (3, 1, {1: 1, 7: 2, 2: 1})
    assert counts.total == 8


def test_in_words_the_commonest_reason_comes_first():
    counts = count_points([frame((0, KNOWN), (1, UNKNOWN), (7, UNKNOWN), (7, UNKNOWN), (2, KNOWN))])
    assert counts.text(STATUS_NAMES) == (
        "1 valid (20.0 %), 1 extrapolated, 3 lost (2 object gone, 1 correlation too low)"
    )


def test_in_words_where_nothing_is_lost_or_nothing_was_measured():
    assert count_points([frame((0, KNOWN))]).text(STATUS_NAMES) == "1 valid (100.0 %), 0 extrapolated, 0 lost"
    assert count_points([]).text(STATUS_NAMES) == "0 valid, 0 extrapolated, 0 lost"
