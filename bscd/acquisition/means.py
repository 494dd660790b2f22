"""Means over the repeated frames of one camera, phase and position."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.names import CameraName, PhaseName
from bscd.acquisition.records import FrameRecord
from drivers.interfaces import FrameStatus


@dataclass(frozen=True, slots=True)
class FrameMean:
    """The mean of ``count`` frames of one camera, phase and target position.

    ``data`` is ``(height, width)`` float32 in grey levels; ``peak`` the brightest pixel of any of the frames
    (a mean hides saturation); the readings are means over the frames that have them, NaN where none has.
    """

    camera: CameraName
    phase: PhaseName
    target_position: int | None
    data: NDArray[np.float32]
    count: int
    peak: int
    y_mm: float
    rotation_deg: float
    jack_mm: float
    pressure_kpa: float


def repeated_frames(table: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    """The rows of a `RunFile.table` that repeat one camera, phase and position, group by group.

    Groups come in the order of their first frame; frames that are not ok are left out.
    """
    groups: dict[tuple[str, str, float | None], list[int]] = {}
    for number, row in enumerate(table):
        if row["status"] == FrameStatus.OK.value:
            position = float(row["target_position"])
            key = (str(row["camera"]), str(row["phase"]), None if math.isnan(position) else position)
            groups.setdefault(key, []).append(number)
    for numbers in groups.values():
        yield table[numbers]


def mean_of_repeats(records: Iterable[FrameRecord]) -> FrameMean:
    """The mean of frames of one camera, phase and position; at least one."""
    frames = iter(records)
    first = next(frames)
    total = first.data.astype(np.float64)
    peak = int(first.data.max())
    seen = [_without_image(first)]
    for frame in frames:
        total += frame.data
        peak = max(peak, int(frame.data.max()))
        seen.append(_without_image(frame))
    return FrameMean(
        camera=first.camera,
        phase=first.phase,
        target_position=first.target_position,
        data=(total / len(seen)).astype(np.float32),
        count=len(seen),
        peak=peak,
        y_mm=_mean([frame.y_mm for frame in seen]),
        rotation_deg=_mean([frame.rotation_deg for frame in seen]),
        jack_mm=_mean([frame.jack_mm for frame in seen]),
        pressure_kpa=_mean([frame.pressure_kpa for frame in seen]),
    )


def _without_image(frame: FrameRecord) -> FrameRecord:
    """The metadata alone, so that a long series does not stay in memory."""
    return replace(frame, data=frame.data[:0])


def _mean(values: list[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan
