"""Which frames of a run are measured, and which are the reference."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import CameraMeta, FrameRecord, RunFile, RunWriter
from bscd.errors import InputError
from bscd.procedures.measuring.frames import FrameChoice, choose_frames, count_at_rest, frame_records, reference_count
from drivers.interfaces import FrameStatus

NAN = float("nan")


def record(camera="primary", phase="inflation", number=0, **known) -> FrameRecord:
    return FrameRecord(camera, phase, np.full((8, 12), number, np.uint8), frame_id=number, **known)


@pytest.fixture
def chosen(tmp_path: Path):
    def choose(records: Sequence[FrameRecord], phase=None, stereo="biprism", raised_mm=70.0) -> FrameChoice:
        path = tmp_path / "run.h5"
        cameras = {r.camera: CameraMeta(12, 8) for r in records}
        with RunWriter(path, title="run", cameras=cameras) as run:
            for one in records:
                run.append(one)
        with RunFile(path) as run:
            choice = choose_frames(run, phase, stereo, raised_mm)
            pairs = list(frame_records(run, choice))
            assert len(pairs) == len(choice)
            choose.shown = [tuple(int(f.data[0, 0]) for f in pair if f is not None) for pair in pairs]
        return choice

    return choose


def inflation(*pressures, **known):
    return [record(number=k, pressure_kpa=p, **known) for k, p in enumerate(pressures)]


@pytest.mark.parametrize(
    ("pressures", "reference"),
    [
        ((0.05, 0.06, 0.04, 0.3, 0.6), (0, 1, 2)),
        ((0.05, 0.3, 0.05, 0.6), (0,)),  # what comes back to the start's pressure is past the ramp
        ((0.05,) * 3 + (NAN,) * 2, (0, 1, 2)),
        ((0.050, 0.052, 0.049, 0.051, 0.050, 0.071, 0.3), (0, 1, 2, 3, 4)),  # the ramp has begun in the sixth
        ((0.050, 0.058, 0.041, 0.055, 0.043, 0.062, 0.3), (0, 1, 2, 3, 4, 5)),  # readings that scatter
        ((NAN, NAN, NAN), (0,)),  # an import: the first frame
        ((0.05,) * 40 + (1.0,), tuple(range(16))),
        ((0.05,) * 3, (0,)),  # no ramp to tell where it begins
        ((0.05,), (0,)),
    ],
)
def test_the_frames_before_the_ramp_are_the_reference(chosen, pressures, reference):
    choice = chosen(inflation(*pressures))
    assert choice.reference == reference
    assert len(choice) == len(pressures)


def test_a_spheres_first_frame_is_the_reference(chosen):
    choice = chosen([record(phase="sphere", number=k, pressure_kpa=0.05) for k in range(3)])
    assert choice.phase == "sphere"
    assert choice.reference == (0,)
    assert choice.size_px == (12, 8)


def test_inflation_is_measured_before_a_sphere_unless_asked(chosen, tmp_path):
    records = [record(phase="sphere", number=9), *inflation(0.05, 1.0)]
    assert chosen(records).phase == "inflation"
    assert chosen.shown == [(0,), (1,)]
    (tmp_path / "run.h5").unlink()
    assert chosen(records, phase="sphere").phase == "sphere"
    assert chosen.shown == [(9,)]


BOTH_HEIGHTS = [
    record(phase="sphere", number=1, jack_mm=70.0),
    record(phase="sphere", number=2, jack_mm=5.0),
    record("auxiliary", phase="sphere", number=3, jack_mm=5.0),
    record(phase="sphere", number=4, jack_mm=70.3),
    record(phase="sphere", number=5, jack_mm=5.0),
    record("auxiliary", phase="sphere", number=6, jack_mm=5.0),
]


def test_with_the_biprism_in_view(chosen):
    chosen(BOTH_HEIGHTS)
    assert chosen.shown == [(1,), (4,)]


def test_the_standard_pair_has_it_out_of_view(chosen):
    chosen(BOTH_HEIGHTS, stereo="standard")
    assert chosen.shown == [(2, 3), (5, 6)]


@pytest.mark.parametrize("raised_mm", [NAN, 70.0])
def test_jacks_that_nobody_knows_of_leave_nothing_out(chosen, raised_mm):
    chosen([record(phase="sphere", number=k) for k in range(3)], raised_mm=raised_mm)
    assert chosen.shown == [(0,), (1,), (2,)]


IMPORTED = [
    record(phase="sphere", number=1, time_s=1.0),
    record(phase="sphere", number=2, time_s=2.0),
    record("auxiliary", phase="sphere", number=3, time_s=2.0),
    record(phase="sphere", number=4),
]


class TestOfAnImport:
    """No jack was read: what the auxiliary camera saw at the same time was without the biprism."""

    def test_the_pair_is_what_was_taken_together(self, chosen):
        chosen(IMPORTED, stereo="standard", raised_mm=NAN)
        assert chosen.shown == [(2, 3)]

    def test_the_rest_is_through_the_biprism(self, chosen):
        chosen(IMPORTED, raised_mm=NAN)
        assert chosen.shown == [(1,), (4,)]

    @pytest.mark.parametrize("stereo", ["biprism", "standard"])
    def test_where_all_were_taken_together_nothing_is_told(self, chosen, stereo):
        chosen(IMPORTED[1:3], stereo=stereo, raised_mm=NAN)
        assert chosen.shown == ([(2,)] if stereo == "biprism" else [(2, 3)])

    def test_without_times_the_counts_must_agree(self, chosen):
        records = [record(phase="sphere", number=1), record("auxiliary", phase="sphere", number=2)]
        chosen(records, stereo="standard", raised_mm=NAN)
        assert chosen.shown == [(1, 2)]


def bad(one: FrameRecord) -> FrameRecord:
    return replace(one, status=FrameStatus.INCOMPLETE)


class TestBadFrames:
    def test_they_are_left_out_and_the_others_keep_their_numbers(self, chosen):
        records = inflation(0.05, 0.05, 1.0, 2.0)
        records[2] = bad(records[2])
        choice = chosen(records)
        assert choice.reference == (0, 1)
        assert choice.numbers == (0, 1, 3)
        assert choice.left_out == ("1 of 4 inflation frames are left out: 1 incomplete in the primary camera (frame 2)")
        assert chosen.shown == [(0,), (1,), (3,)]

    def test_at_rest_they_are_no_part_of_the_reference(self, chosen):
        records = inflation(0.05, 0.05, 0.05, 0.3, 2.0)
        records[0], records[2] = bad(records[0]), bad(records[2])
        choice = chosen(records)
        assert [choice.numbers[place] for place in choice.reference] == [1]
        assert choice.numbers == (1, 3, 4)

    def test_numbers_are_those_among_the_frames_of_the_pair_of_views(self, chosen):
        records = [*BOTH_HEIGHTS, record(phase="sphere", number=7, jack_mm=70.0)]
        records[3] = bad(records[3])
        choice = chosen(records)
        assert chosen.shown == [(1,), (7,)]
        assert choice.numbers == (0, 2)

    def test_none_is_named_where_there_is_none(self, chosen):
        assert chosen(inflation(0.05, 1.0)).left_out == ""

    def test_many_are_counted_and_the_first_are_named(self, chosen):
        records = [*map(bad, inflation(*[0.05] * 8)), record(number=8)]
        assert chosen(records).left_out == (
            "8 of 9 inflation frames are left out: 8 incomplete in the primary camera (frames 0, 1, 2, 3, 4, ...)"
        )

    def test_nothing_but_bad_ones_is_refused_as_that(self, chosen):
        said = r"none of its 2 inflation frames is whole: 2 incomplete in the primary camera \(frames 0, 1\); record"
        with pytest.raises(InputError, match=said):
            chosen([bad(one) for one in inflation(0.05, 1.0)])


def pairs(*times_s, auxiliary_s=None, **known) -> list[FrameRecord]:
    """Of both cameras, one after the other; frame k shows k in the primary camera and 100 + k in the auxiliary one."""
    auxiliary_s = times_s if auxiliary_s is None else auxiliary_s
    return [
        *(record(phase="sphere", number=k, time_s=s, **known) for k, s in enumerate(times_s)),
        *(record("auxiliary", phase="sphere", number=100 + k, time_s=s, **known) for k, s in enumerate(auxiliary_s)),
    ]


class TestWhatWasTakenTogether:
    @pytest.mark.parametrize("timed", [True, False])
    def test_a_bad_frame_of_either_camera_takes_its_partner_with_it(self, chosen, timed):
        records = pairs(*(k / 11 if timed else NAN for k in range(5)), jack_mm=5.0)
        records[1], records[5 + 3] = bad(records[1]), bad(records[5 + 3])
        choice = chosen(records, stereo="standard")
        assert chosen.shown == [(0, 100), (2, 102), (4, 104)]
        assert choice.numbers == (0, 2, 4)
        assert choice.left_out == (
            "2 of 5 sphere frames are left out: 1 incomplete in the primary camera (frame 1), "
            "1 incomplete in the auxiliary camera (frame 3)"
        )

    def test_a_frame_that_one_camera_lacks_is_told_by_the_times(self, chosen):
        choice = chosen(pairs(0.0, 0.1, 0.2, 0.3, auxiliary_s=(0.0, 0.2, 0.3, 0.4), jack_mm=5.0), stereo="standard")
        assert chosen.shown == [(0, 100), (2, 101), (3, 102)]
        assert choice.numbers == (0, 2, 3)
        assert choice.left_out.endswith("1 without an auxiliary image of its time (frame 1)")

    def test_times_may_be_a_little_apart(self, chosen):
        chosen(pairs(0.0, 0.1, 0.2, auxiliary_s=(0.0, 0.101, 0.198), jack_mm=5.0), stereo="standard")
        assert chosen.shown == [(0, 100), (1, 101), (2, 102)]

    def test_cameras_that_took_turns_are_paired_in_their_order(self, chosen):
        chosen(pairs(0.0, 0.2, 0.4, auxiliary_s=(0.1, 0.3, 0.5), jack_mm=5.0), stereo="standard")
        assert chosen.shown == [(0, 100), (1, 101), (2, 102)]

    def test_times_that_are_all_the_same_tell_nothing(self, chosen):
        chosen(pairs(0.0, 0.0, 0.0, jack_mm=5.0), stereo="standard")
        assert chosen.shown == [(0, 100), (1, 101), (2, 102)]

    def test_in_whatever_order_they_stand(self, chosen):
        chosen(pairs(0.0, 0.1, 0.2, auxiliary_s=(0.2, 0.0, 0.1), jack_mm=5.0), stereo="standard")
        assert chosen.shown == [(0, 101), (1, 102), (2, 100)]

    @pytest.mark.parametrize("timed", [True, False])
    def test_both_cameras_at_both_heights(self, chosen, timed):
        records = [
            record(camera, phase="sphere", number=number + 100 * (camera == "auxiliary"), jack_mm=jack, time_s=s)
            for number, (jack, s) in enumerate(((70.0, 0.0), (5.0, 0.1), (70.0, 0.2), (5.0, 0.3)))
            for camera in ("primary", "auxiliary")
            for s in [s if timed else NAN]
        ]
        chosen(records, stereo="standard")
        assert chosen.shown == [(1, 101), (3, 103)]

    def test_not_one_of_them_whole(self, chosen):
        records = pairs(0.0, 0.1, jack_mm=5.0)
        records[0], records[3] = bad(records[0]), bad(records[3])
        with pytest.raises(InputError, match=r"none of its 2 sphere frames is whole: 1 incomplete in the primary"):
            chosen(records, stereo="standard")


@pytest.mark.parametrize(
    ("records", "wanted", "said"),
    [
        ([record(phase="bsc-face")], {}, "it has no inflation or sphere frames of the primary camera"),
        (inflation(0.05), {"phase": "sphere"}, "it has no sphere frames of the primary camera"),
        ([record("auxiliary", phase="sphere")], {}, "it has no inflation or sphere frames of the primary camera"),
        (inflation(0.05, jack_mm=5.0), {}, "none of its inflation frames can be measured as biprism pair"),
        (inflation(0.05), {"stereo": "standard"}, "it has no auxiliary camera; the standard pair needs both"),
        (BOTH_HEIGHTS[:-1], {"stereo": "standard"}, "2 sphere frames of the primary camera .*, 1 of the auxiliary"),
    ],
    ids=["no phase", "not this phase", "no primary", "biprism lowered", "no auxiliary", "one missing"],
)
def test_nothing_to_measure(chosen, records, wanted, said):
    with pytest.raises(InputError, match=said) as error:
        chosen(records, **wanted)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("rest", [1, 5, 15, 16, 31, 32, 33, 90])
def test_the_reference_is_known_while_frames_come_as_it_is_from_all_of_them(rest):
    """A long rest, or a ramp so slow that it has not risen yet, makes no other reference than the whole run."""
    rng = np.random.default_rng(rest)
    ramp = np.linspace(0.1, 8.0, 60)
    pressures = np.concatenate([np.full(rest, 0.05), ramp]) + rng.normal(0.0, 0.002, rest + 60)
    whole = min(count_at_rest(pressures), 16)
    known = next(
        found
        for count in range(1, len(pressures) + 1)
        if (found := reference_count(pressures[:count], "inflation", ended=False)) is not None
    )
    assert known == whole
