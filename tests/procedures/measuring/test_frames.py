"""Which frames of a run are measured, and which are the reference."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import CameraMeta, FrameRecord, RunFile, RunWriter
from bscd.errors import InputError
from bscd.procedures.measuring.frames import FrameChoice, choose_frames, frame_records
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


def test_bad_frames_are_left_out(chosen):
    records = inflation(0.05, 0.05, 1.0, 2.0)
    records[2] = record(number=2, pressure_kpa=1.0, status=FrameStatus.INCOMPLETE)
    assert chosen(records).reference == (0, 1)
    assert chosen.shown == [(0,), (1,), (3,)]


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
