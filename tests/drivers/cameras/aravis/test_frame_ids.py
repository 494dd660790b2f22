"""The frame count: over the 16 bit wrap, over losses, over a new acquisition and over a camera that starts anew."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cameras.aravis.frame_ids import GIGE_IDS, FrameCount


def counted(raws, *, wraps=True):
    count = FrameCount(wraps=wraps)
    return [count.count(raw) for raw in raws]


@pytest.mark.parametrize(
    ("raws", "ids", "missing"),
    [
        ([65534, 65535, 1, 2], [0, 1, 2, 3], [0, 0, 0, 0]),
        ([65533, 1, 3], [0, 3, 5], [0, 2, 1]),
        ([7, 8, 12], [0, 1, 5], [0, 0, 3]),
        ([7, 7, 8], [0, 1, 2], [0, 0, 0]),
    ],
)
def test_counts(raws, ids, missing):
    assert counted(raws) == list(zip(ids, missing, strict=True))


def test_wide_ids_do_not_wrap():
    assert counted([65535, 65536, 65538], wraps=False) == [(0, 0), (1, 0), (3, 1)]
    assert counted([70000, 70001, 70003]) == [(0, 0), (1, 0), (3, 1)]


@given(st.integers(1, GIGE_IDS), st.lists(st.integers(1, 30_000), min_size=1, max_size=40))
def test_every_missing_frame_is_counted_wherever_it_wraps(first, steps):
    raws, true = [first], [0]
    for step in steps:
        raws.append((raws[-1] - 1 + step) % GIGE_IDS + 1)
        true.append(true[-1] + step)
    results = counted(raws)
    assert [frame_id for frame_id, _ in results] == true
    assert sum(missing for _, missing in results) == true[-1] - len(steps)


@pytest.mark.parametrize(("raw", "frame_id"), [(11, 1), (14, 4), (1, 1), (5000, 1), (9, 1)])
def test_a_new_acquisition_goes_on_or_starts_anew_and_lost_nothing(raw, frame_id):
    count = FrameCount(wraps=True)
    count.count(10)
    count.begin()
    assert count.count(raw) == (frame_id, 0)


def test_a_camera_that_came_back_leaves_a_gap():
    count = FrameCount(wraps=True)
    count.count(65400)
    count.forget(97)
    count.begin()
    assert count.next_id == 98
    assert count.count(65401) == (98, 0)
    assert count.count(65403) == (100, 1)
