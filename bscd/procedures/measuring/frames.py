"""Which frames of a run are measured, and which of them are the reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition import FrameRecord, PhaseName, RunFile
from bscd.arrays import BoolArray, FloatArray, IntArray
from bscd.errors import InputError
from bscd.procedures.measuring.pairing import taken_together
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

#: No more frames than these are named in a sentence.
_NAMED = 5

#: Without readings of the pressure, or in a sphere's frames, the first one is the reference.
_MEASURED: tuple[PhaseName, ...] = ("inflation", "sphere")


@dataclass(frozen=True)
class FrameChoice:
    """The frames of one measurement: their rows in the primary camera (and the auxiliary one beside them).

    ``numbers`` are theirs as recorded: they count from 0 among the phase's frames of the pair of views, those among
    them that can not be measured; ``left_out`` says in a sentence which these are and why, empty where there are none.
    ``reference`` are the places among the measured ones whose mean is the reference. ``size_px`` is (width, height) of
    the primary camera's images, ``auxiliary_size_px`` of the auxiliary one's where it takes part.
    """

    phase: PhaseName
    primary: tuple[int, ...]
    auxiliary: tuple[int, ...]
    numbers: tuple[int, ...]
    reference: tuple[int, ...]
    size_px: tuple[int, int]
    auxiliary_size_px: tuple[int, int] | None
    left_out: str

    def __len__(self) -> int:
        """How many frames are measured."""
        return len(self.primary)


def choose_frames(run: RunFile, phase: PhaseName | None, stereo: StereoSource, raised_mm: float) -> FrameChoice:
    """The frames of a phase (None: inflation, else sphere) that a pair of views can measure.

    Frames with the biprism out of view are left out for the biprism's views, and those with it in view for the
    standard pair. Where the jacks' height is not known (an import), primary frames of one time with an auxiliary one
    are the standard pair's, unless all are. Then frames of which an image is missing or not whole are left out. Raises
    `InputError` when there are none.
    """
    there: set[str] = {str(name) for name in run.table("primary")["phase"]} if "primary" in run.cameras else set()
    chosen: PhaseName | None = phase or next((name for name in _MEASURED if name in there), None)
    if chosen is None or chosen not in there:
        wanted = phase or " or ".join(_MEASURED)
        raise InputError(f"{run.path}: it has no {wanted} frames of the primary camera; record or import them")
    table = run.table("primary", chosen)
    other = run.table("auxiliary", chosen) if "auxiliary" in run.cameras else None
    raised, known = _raised(table, raised_mm)
    paired = np.zeros(len(table), bool) if other is None else np.isin(table["time_s"], other["time_s"])
    told = paired.any() and not paired[~known].all()
    for_biprism = np.where(known, raised, ~paired if told else True)
    for_pair = np.where(known, ~raised, paired if told else True)
    table = table[for_biprism if stereo == "biprism" else for_pair]
    reasons = _not_whole(table, "primary")
    beside = np.zeros(len(table), np.int64)
    if stereo == "standard":
        if other is None:
            raise InputError(f"{run.path}: it has no auxiliary camera; the standard pair needs both")
        raised, known = _raised(other, raised_mm)
        beside, reasons = _beside(run, chosen, table, other[~(known & raised)], reasons)
    if not len(table):
        raise InputError(f"{run.path}: none of its {chosen} frames can be measured as {stereo} pair")
    numbers = [number for number, reason in enumerate(reasons) if not reason]
    left_out = _told(reasons)
    if not numbers:
        raise InputError(
            f"{run.path}: none of its {len(table)} {chosen} frames is whole: {left_out}; record them again"
        )
    sizes_px = {name: (camera.width_px, camera.height_px) for name, camera in run.cameras.items()}
    return FrameChoice(
        chosen,
        tuple(table["sequence_number"][numbers].tolist()),
        tuple(beside[numbers].tolist()) if stereo == "standard" else (),
        tuple(numbers),
        _at_rest(table["pressure_kpa"][numbers], chosen),
        sizes_px["primary"],
        sizes_px["auxiliary"] if stereo == "standard" else None,
        left_out and f"{len(table) - len(numbers)} of {len(table)} {chosen} frames are left out: {left_out}",
    )


def _raised(table: NDArray[np.void], raised_mm: float) -> tuple[BoolArray, BoolArray]:
    """Whether the biprism is in view in frames, and whether that is known."""
    jack_mm = table["jack_mm"]
    return np.abs(jack_mm - raised_mm) <= JACK_MM, np.isfinite(jack_mm) & np.isfinite(raised_mm)


def _not_whole(table: NDArray[np.void], camera: str) -> list[str]:
    """Why frames can not be measured, "" where they can."""
    return ["" if status == "ok" else f"{status} in the {camera} camera" for status in table["status"].tolist()]


def _beside(
    run: RunFile, phase: PhaseName, table: NDArray[np.void], other: NDArray[np.void], reasons: list[str]
) -> tuple[IntArray, list[str]]:
    """The row of the auxiliary frame that was taken with each primary one, and why a pair can not be measured."""
    places = taken_together(table["time_s"], other["time_s"])
    if places is None:
        raise InputError(
            f"{run.path}: {len(table)} {phase} frames of the primary camera without the biprism, {len(other)} of "
            f"the auxiliary; the standard pair needs one of each, of the same time where others show the biprism"
        )
    whole = [*_not_whole(other, "auxiliary"), "without an auxiliary image of its time"]  # the last one is at place -1
    rows = np.append(other["sequence_number"], -1).astype(np.int64)
    return rows[places], [reason or whole[place] for reason, place in zip(reasons, places.tolist(), strict=True)]


def _told(reasons: Sequence[str]) -> str:
    """Like ``2 incomplete in the primary camera (frames 3, 8)``, reason by reason."""
    parts = []
    for reason in dict.fromkeys(filter(None, reasons)):
        numbers = [number for number, one in enumerate(reasons) if one == reason]
        named = ", ".join(str(number) for number in numbers[:_NAMED]) + (", ..." if len(numbers) > _NAMED else "")
        parts.append(f"{len(numbers)} {reason} (frame{'s' if len(numbers) > 1 else ''} {named})")
    return ", ".join(parts)


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
    if phase == "inflation" and not (risen or ended):
        return _MOST_AT_REST  # whenever it rises, half of these are enough
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

    ``which`` are the places in the choice of those that are wanted, ascending (None: all); no other is read.
    """
    which = range(len(choice)) if which is None else which
    frames = run.frames("primary", choice.phase, [choice.primary[place] for place in which])
    if not choice.auxiliary:
        for frame in frames:
            yield frame, None
        return
    rows = [choice.auxiliary[place] for place in which]
    in_order = [rows] if rows == sorted(rows) else [[row] for row in rows]  # a reader gives them in the order recorded
    others = chain.from_iterable(run.frames("auxiliary", choice.phase, some) for some in in_order)
    yield from zip(frames, others, strict=True)
