"""Measure a run: DIC and 3D for every frame, kept in a results file or handed on."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from bscd.acquisition import FrameRecord, RunFile
from bscd.analysis.surface import MembraneFrame as FittedFrame
from bscd.calibration import Calibration
from bscd.dic.pool import Pool
from bscd.errors import InputError
from bscd.procedures.measuring.beginning import Begun, begin, view_source
from bscd.procedures.measuring.frames import FrameChoice, choose_frames, frame_records
from bscd.procedures.measuring.overlap import one_ahead, plain_linear_algebra
from bscd.procedures.measuring.pooled import PooledTracking
from bscd.procedures.measuring.sequence import Measured, Sequence
from bscd.procedures.measuring.settings import MeasureSettings
from bscd.procedures.measuring.views import FrameImages
from bscd.procedures.progress import Progress, ProgressCallback
from bscd.results import FrameResult, Origin, ResultsHeader, ResultsWriter


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measurement under way: what describes it, and its frames when their turn comes.

    ``sequence`` holds the reference's match; ``frame`` the membrane frame, None where there is none.
    """

    header: ResultsHeader
    choice: FrameChoice
    sequence: Sequence
    frame: FittedFrame | None
    frames: Generator[FrameResult]


@plain_linear_algebra()
def measure_run(
    calibration: Calibration,
    run: RunFile,
    settings: MeasureSettings | None = None,
    *,
    calibration_name: str = "",
    progress: ProgressCallback | None = None,
    warn: Callable[[str], None] | None = None,
    pool: Pool | None = None,
) -> Measurement:
    """Begin to measure; the frames are read and matched one at a time, so memory does not grow with their number.

    Unless ``threads`` is 1 a frame is read and the next is matched, each on a thread, while one's result is used. With
    a ``pool`` its workers track; results are the same. Close ``frames`` where they are not taken to their end.

    Raises `InputError` for a calibration, run or settings that do not fit each other. What can not be measured in a
    frame is NaN there with its reason as status.
    """
    settings = settings or MeasureSettings()
    choice = choose_frames(run, settings.phase, settings.stereo, calibration.jack_mm)
    warn = warn or (lambda _: None)
    if choice.left_out:
        warn(f"{run.path}: {choice.left_out}")
    source = view_source(calibration, choice.size_px, settings, choice.auxiliary_size_px)
    taken = [images_of(*pair) for pair in islice(frame_records(run, choice), len(choice.reference))]
    numbers = [choice.numbers[place] for place in choice.reference]
    begun = begin(
        calibration, source, taken, choice.phase, settings, run_name=str(run.path), warn=warn, numbers=numbers
    )
    header = begun.header(run.title, Origin(run.path.name, run.uuid, run.checksum), calibration_name)
    return Measurement(header, choice, begun.sequence, begun.frame, _frames(run, choice, begun, progress, pool))


def measure_to_file(
    calibration: Calibration,
    run: RunFile,
    path: str | Path,
    settings: MeasureSettings | None = None,
    *,
    calibration_name: str = "",
    progress: ProgressCallback | None = None,
    warn: Callable[[str], None] | None = None,
    pool: Pool | None = None,
) -> ResultsHeader:
    """Measure a run into a new results file; what was measured stays readable if it is cut off."""
    if Path(path).exists():
        raise InputError(f"{path}: exists already; results are never overwritten, choose another name")
    measurement = measure_run(
        calibration, run, settings, calibration_name=calibration_name, progress=progress, warn=warn, pool=pool
    )
    with (
        closing(measurement.frames),
        ResultsWriter(path, measurement.header, flush_every=10) as writer,
    ):
        for frame in measurement.frames:
            writer.append(frame)
    return measurement.header


def images_of(primary: FrameRecord, auxiliary: FrameRecord | None) -> FrameImages:
    """A frame's images as they were taken."""
    return (primary.data,) if auxiliary is None else (primary.data, auxiliary.data)


def _frames(
    run: RunFile, choice: FrameChoice, begun: Begun, progress: ProgressCallback | None, pool: Pool | None
) -> Generator[FrameResult]:
    matched = _matched(frame_records(run, choice), begun) if pool is None else _by_pool(run, choice, begun, pool)
    ahead = one_ahead(matched) if begun.settings.threads != 1 or pool is not None else matched
    with plain_linear_algebra(), closing(matched), closing(ahead):
        for done, (number, (primary, measured)) in enumerate(zip(choice.numbers, ahead, strict=True), 1):
            yield begun.result(number, primary.time_s, primary.pressure_kpa, measured)
            if progress is not None:
                progress(Progress(done, len(choice), f"{choice.phase} frame {number}"))


def _matched(
    frames: Iterator[tuple[FrameRecord, FrameRecord | None]], begun: Begun
) -> Generator[tuple[FrameRecord, Measured]]:
    read = ((primary, begun.source.views(images_of(primary, auxiliary))) for primary, auxiliary in frames)
    for primary, views in one_ahead(read) if begun.settings.threads != 1 else read:
        yield primary, begun.sequence.measure(views)


def _by_pool(run: RunFile, choice: FrameChoice, begun: Begun, pool: Pool) -> Generator[tuple[FrameRecord, Measured]]:
    frames = ((primary, images_of(primary, auxiliary)) for primary, auxiliary in frame_records(run, choice))
    with PooledTracking(pool, begun) as tracking:
        for primary, left, right in tracking.follow(frames):
            yield primary, begun.sequence.combine(left, right)
