"""What the recorder's process and the live one tell each other."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bscd.acquisition.names import PhaseName
from bscd.arrays import FloatArray
from bscd.dic.pool import SharedImage
from bscd.procedures.measuring.settings import MeasureSettings
from bscd.results import Origin

if TYPE_CHECKING:
    from bscd.calibration import Calibration


@dataclass(frozen=True, eq=False)
class LiveSetup:
    """What is measured live, with what, and where the results go.

    ``size_px`` is the images' (width, height); ``run`` names the run that is being recorded, ``title`` is its title.
    ``workers`` processes track, at a priority lowered by ``nice``. ``event_points`` at most are in an event.
    """

    calibration: Calibration
    size_px: tuple[int, int]
    out: Path
    title: str
    run: Origin
    calibration_name: str = ""
    phase: PhaseName = "inflation"
    settings: MeasureSettings = field(default_factory=lambda: MeasureSettings(phase="inflation"))
    workers: int = 2
    nice: int = 10
    event_points: int = 500


@dataclass(frozen=True, eq=False)
class PushedFrame:
    """A frame on its way: its number among the recorded frames, where its image is, when it was exposed."""

    number: int
    image: SharedImage
    time_s: float
    pressure_kpa: float
    exposed_ns: int


@dataclass(frozen=True)
class DamagedFrame:
    """A frame that has a number among the recorded ones and is not measured."""

    number: int


@dataclass(frozen=True)
class TakenFrame:
    """An image was read; its memory may be used again."""

    name: str


@dataclass(frozen=True)
class LiveReady:
    """The live process and its workers have loaded what they need."""


@dataclass(frozen=True)
class Finish:
    """No more frames come; what was missed is in this run file (None: nothing is caught up)."""

    run: Path | None


@dataclass(frozen=True)
class GiveUp:
    """Nobody waits for the results any more: end at once, the results file as interrupted for this reason.

    ``run`` is the finished run, None where there is none as yet.
    """

    reason: str
    run: Path | None = None


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A frame's map, thinned out: ``index`` ``(n,)`` are the points' rows in the results file.

    ``points_px`` ``(n, 2)``, ``xyz_mm``, ``uvw_mm``, ``sigma_mm`` ``(n, 3)``, ``zncc`` ``(n,)``, ``status`` ``(n,)``.
    ``valid`` of ``points`` were measured, ``w_max_mm`` is the largest w among them (NaN without a membrane frame);
    ``latency_s`` is the time from exposure until the map was there. A
    ``provisional`` frame came after one that was missed: it is measured again from the run file at the end.
    """

    number: int
    time_s: float
    pressure_kpa: float
    points: int
    valid: int
    w_max_mm: float
    latency_s: float
    provisional: bool
    index: NDArray[np.int64]
    points_px: FloatArray
    xyz_mm: FloatArray
    uvw_mm: FloatArray
    sigma_mm: FloatArray
    zncc: FloatArray
    status: NDArray[np.uint8]


@dataclass(frozen=True)
class LiveCatchingUp:
    """The recording has ended; ``done`` of ``total`` frames that were missed are measured from the run file."""

    done: int
    total: int


@dataclass(frozen=True)
class LiveWarning:
    """Something that the operator should know; the measurement goes on."""

    text: str


@dataclass(frozen=True)
class LiveFailure:
    """Live measuring ended with an error; recording goes on, and the run can be measured afterwards."""

    text: str


@dataclass(frozen=True)
class LiveDone:
    """The results are complete: so many frames, of which so many were caught up from the run file."""

    frames: int
    caught_up: int
    worker_restarts: int


LiveEvent = LiveFrame | LiveCatchingUp | LiveWarning | LiveFailure | LiveDone
