"""Which frames of a run are measured, and which of them are the reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bscd.acquisition import FrameRecord, PhaseName, RunFile
from bscd.arrays import FloatArray
from bscd.errors import InputError
from bscd.results import StereoSource

#: The pressure's rise above its start that ends the frames before the ramp.
_AT_REST_KPA = 0.03

#: Readings farther than this from the middle of those before belong to the ramp already.
_RISEN_SIGMAS = 6.0
_LEAST_RISE_KPA = 0.002

#: More frames than these bring the reference's noise no further down.
_MOST_AT_REST = 16

#: How far the jacks may stand from where they stood in the calibration's biprism scan.
JACK_MM = 0.5

#: Without readings of the pressure, or in a sphere's frames, the first one is the reference.
_MEASURED: tuple[PhaseName, ...] = ("inflation", "sphere")


@dataclass(frozen=True)
class FrameChoice:
    """The frames of one measurement: their rows in the primary camera (and the auxiliary one beside them).

    ``numbers`` count from 0 as recorded among the measured frames; ``reference`` are the numbers whose mean is the
    reference.
    """

    phase: PhaseName
    primary: tuple[int, ...]
    auxiliary: tuple[int, ...]
    reference: tuple[int, ...]
    size_px: tuple[int, int]

    def __len__(self) -> int:
        """How many frames are measured."""
        return len(self.primary)


def choose_frames(run: RunFile, phase: PhaseName | None, stereo: StereoSource, raised_mm: float) -> FrameChoice:
    """The frames of a phase (None: inflation, else sphere) that a pair of views can measure.

    Frames with the biprism out of view are left out for the biprism's views, and those with it in view for the
    standard pair. Where the jacks' height is not known (an import), primary frames of one time with an auxiliary one
    are the standard pair's, unless all are. Raises `InputError` when there are none.
    """
    there: set[str] = {str(name) for name in run.table("primary")["phase"]} if "primary" in run.cameras else set()
    chosen: PhaseName | None = phase or next((name for name in _MEASURED if name in there), None)
    if chosen is None or chosen not in there:
        wanted = phase or " or ".join(_MEASURED)
        raise InputError(f"{run.path}: it has no {wanted} frames of the primary camera; record or import them")
    table = run.table("primary", chosen)
    other = run.table("auxiliary", chosen) if "auxiliary" in run.cameras else None
    raised = np.abs(table["jack_mm"] - raised_mm) <= JACK_MM
    known = np.isfinite(table["jack_mm"]) & np.isfinite(raised_mm)
    paired = np.zeros(len(table), bool) if other is None else np.isin(table["time_s"], other["time_s"])
    told = paired.any() and not paired[~known].all()
    for_biprism = np.where(known, raised, ~paired if told else True)
    for_pair = np.where(known, ~raised, paired if told else True)
    table = table[(for_biprism if stereo == "biprism" else for_pair) & (table["status"] == "ok")]
    auxiliary: tuple[int, ...] = ()
    if stereo == "standard":
        if other is None:
            raise InputError(f"{run.path}: it has no auxiliary camera; the standard pair needs both")
        other = other[other["status"] == "ok"]
        if len(other) != len(table):
            raise InputError(
                f"{run.path}: {len(table)} {chosen} frames of the primary camera without the biprism, {len(other)} of "
                f"the auxiliary; the standard pair needs one of each, of the same time where others show the biprism"
            )
        auxiliary = tuple(int(row) for row in other["sequence_number"])
    if not len(table):
        raise InputError(f"{run.path}: none of its {chosen} frames can be measured as {stereo} pair")
    camera = run.cameras["primary"]
    return FrameChoice(
        chosen,
        tuple(int(row) for row in table["sequence_number"]),
        auxiliary,
        _at_rest(table["pressure_kpa"], chosen),
        (camera.width_px, camera.height_px),
    )


def reference_count(pressure_kpa: FloatArray, phase: PhaseName, *, ended: bool) -> int | None:
    """How many of the first frames are the reference, by the pressures ``(T,)`` so far.

    None while frames to come may still tell; ``ended`` says that none will come. The rest counts as over with the
    first frame above it, and as long enough when half of it would do (`count_at_rest`).
    """
    if not len(pressure_kpa):
        return None
    risen = not np.isfinite(pressure_kpa[0]) or bool((~(np.abs(pressure_kpa - pressure_kpa[0]) <= _AT_REST_KPA)).any())
    if not (ended or risen or phase != "inflation" or len(pressure_kpa) >= 2 * _MOST_AT_REST):
        return None
    return len(_at_rest(pressure_kpa, phase))


def _at_rest(pressure_kpa: FloatArray, phase: PhaseName) -> tuple[int, ...]:
    """The frames that make the reference."""
    return tuple(range(min(count_at_rest(pressure_kpa), _MOST_AT_REST) if phase == "inflation" else 1))


def count_at_rest(pressure_kpa: FloatArray) -> int:
    """How many frames come before the ramp of pressures ``(T,)``; 1 where nothing tells rest from ramp."""
    if not np.isfinite(pressure_kpa[0]):
        return 1
    rising = ~(np.abs(pressure_kpa - pressure_kpa[0]) <= _AT_REST_KPA)
    before = pressure_kpa[: int(np.argmax(rising)) if rising.any() else 1]
    # where the rise begins shows against the readings' own scatter: a flat membrane moves far with little pressure
    off = np.abs(before - np.median(before))
    risen = np.flatnonzero(off > max(_RISEN_SIGMAS * 1.4826 * float(np.median(off)), _LEAST_RISE_KPA))
    late = risen[risen > len(before) // 2]
    return int(late[0]) if len(late) else len(before)


def frame_records(
    run: RunFile, choice: FrameChoice, which: Sequence[int] | None = None
) -> Iterator[tuple[FrameRecord, FrameRecord | None]]:
    """The chosen frames in the order recorded, with the auxiliary camera's where there is one.

    ``which`` are the numbers of those that are wanted, ascending (None: all); no other is read.
    """
    which = range(len(choice)) if which is None else which
    frames = run.frames("primary", choice.phase, [choice.primary[number] for number in which])
    if not choice.auxiliary:
        for frame in frames:
            yield frame, None
        return
    others = run.frames("auxiliary", choice.phase, [choice.auxiliary[number] for number in which])
    yield from zip(frames, others, strict=False)
