"""The frame count: over the 16 bit wrap, over losses, over a new acquisition and over a camera that starts anew."""

from itertools import pairwise

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
        ([40000, 40001, None, 40003], [0, 1, 2, 3], [0, 0, 0, 0]),
        ([40000, None, None, 40005, 40006], [0, 1, 2, 5, 6], [0, 0, 0, 2, 0]),
        ([65534, None, 1, None, 4], [0, 1, 2, 3, 5], [0, 0, 0, 0, 1]),
        ([None, 7, 8], [0, 1, 2], [0, 0, 0]),
        ([7, None, 7, 8], [0, 1, 2, 3], [0, 0, 0, 0]),
    ],
)
def test_counts(raws, ids, missing):
    assert counted(raws) == list(zip(ids, missing, strict=True))


def test_wide_ids_do_not_wrap():
    assert counted([65535, 65536, 65538], wraps=False) == [(0, 0), (1, 0), (3, 1)]
    assert counted([70000, 70001, 70003]) == [(0, 0), (1, 0), (3, 1)]
    assert counted([65535, None, 65537, 65539]) == [(0, 0), (1, 0), (2, 0), (4, 1)]


def test_wide_ids_may_begin_at_zero():
    assert counted([0, 1, None, 3, 6], wraps=False) == [(0, 0), (1, 0), (2, 0), (3, 0), (6, 2)]


@given(st.integers(1, GIGE_IDS), st.lists(st.integers(1, 30_000), min_size=1, max_size=40))
def test_every_missing_frame_is_counted_wherever_it_wraps(first, steps):
    raws, true = [first], [0]
    for step in steps:
        raws.append((raws[-1] - 1 + step) % GIGE_IDS + 1)
        true.append(true[-1] + step)
    results = counted(raws)
    assert [frame_id for frame_id, _ in results] == true
    assert sum(missing for _, missing in results) == true[-1] - len(steps)


@given(
    st.integers(1, GIGE_IDS),
    st.lists(st.sampled_from(["told", "untold", "gone"]), max_size=300),
)
def test_frames_whose_id_is_lost_are_counted_once(first, fates):
    fates = ["told", *fates, "told"]
    came = [number for number, fate in enumerate(fates) if fate != "gone"]
    raws = [(first - 1 + number) % GIGE_IDS + 1 if fates[number] == "told" else None for number in came]
    results = counted(raws)
    ids = [frame_id for frame_id, _ in results]
    assert all(after > before for before, after in pairwise(ids))
    assert all(ids[k] == came[k] for k, raw in enumerate(raws) if raw is not None)
    assert sum(missing for _, missing in results) == fates.count("gone")


@pytest.mark.parametrize(("raw", "frame_id"), [(11, 1), (14, 4), (1, 1), (5000, 1), (9, 1)])
def test_a_new_acquisition_goes_on_or_starts_anew_and_lost_nothing(raw, frame_id):
    count = FrameCount(wraps=True)
    count.count(10)
    count.begin()
    assert count.count(raw) == (frame_id, 0)


def test_a_new_acquisition_whose_first_id_is_lost_lost_nothing_before_it():
    count = FrameCount(wraps=True)
    count.count(10)
    count.begin()
    assert [count.count(raw) for raw in (None, 40, 41, 43)] == [(1, 0), (30, 0), (31, 0), (33, 1)]


def test_a_camera_that_came_back_leaves_a_gap():
    count = FrameCount(wraps=True)
    count.count(65400)
    count.forget(97)
    count.begin()
    assert count.next_id == 98
    assert count.count(65401) == (98, 0)
    assert count.count(65403) == (100, 1)
