"""Measure frames as they come, in the live process: reference first, then tracked on the pool, written and told."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from bscd.acquisition import FrameRecord, RunFile
from bscd.arrays import BoolArray, FloatArray
from bscd.dic.pool import LocalPool, MemoryFullError
from bscd.dic.tracker_state import REFERENCE, TrackerState
from bscd.errors import BscdError
from bscd.procedures.live.messages import Finish, LiveCatchingUp, LiveDone, LiveEvent, LiveFrame, LiveSetup, LiveWarning
from bscd.procedures.measuring.beginning import Begun, begin, view_source
from bscd.procedures.measuring.frames import FrameChoice, choose_frames, frame_records, reference_count
from bscd.procedures.measuring.measure import images_of
from bscd.procedures.measuring.overlap import plain_linear_algebra
from bscd.procedures.measuring.pooled import PooledTracking
from bscd.procedures.measuring.views import FrameImages
from bscd.results import FrameResult, ResultsWriter

#: Frames that are tracked or wait for it; of those that wait so many go into one task.
UNDER_WAY = 6
CHUNK = 3

_FLUSH_EVERY = 5


@dataclass(frozen=True, eq=False)
class ArrivedFrame:
    """A frame in the live process."""

    number: int
    images: FrameImages
    time_s: float
    pressure_kpa: float
    exposed_ns: int


@dataclass(frozen=True, eq=False)
class _Complete:
    """Up to where the results are those of all frames: what to go on from when the run file is there.

    ``number`` is the first frame's that is not among them, ``frames`` how many there are.
    """

    number: int
    frames: int
    states: tuple[TrackerState, TrackerState]
    stray: BoolArray


class LiveEngine:
    """`push` frames in order, then `finish`; a context manager that ends its threads and its file.

    After a frame that did not come the maps are provisional: they are told, and measured again by `finish`.
    """

    def __init__(self, setup: LiveSetup, pool: LocalPool, tell: Callable[[LiveEvent], None]) -> None:
        self._setup, self._pool, self._tell = setup, pool, tell
        self._source = view_source(setup.calibration, setup.size_px, setup.settings)
        self._first: list[ArrivedFrame] = []
        self._begun: Begun | None = None
        self._tracking: PooledTracking | None = None
        self._writer: ResultsWriter | None = None
        self._complete: _Complete | None = None
        self._next = 0
        self._under_way: queue.Queue[ArrivedFrame | None] = queue.Queue(UNDER_WAY)
        self._results = threading.Thread(target=self._take_results, name="live results", daemon=True)
        self._failure: BaseException | None = None
        self._linear_algebra = plain_linear_algebra()
        self._linear_algebra.__enter__()

    def push(self, frame: ArrivedFrame) -> None:
        """Measure the next frame that came; waits while enough are under way. Raises what went wrong with those."""
        missed = frame.number != self._next
        if self._begun is None:
            if missed:
                return  # the reference would not be the run's: all is left for the run file
            self._first.append(frame)
            self._next = frame.number + 1
            self._begin_when_told(ended=False)
            return
        if missed and self._complete is None:
            self._drain()
            self._complete = self._stand()
        with suppress(MemoryFullError):  # left out, as one that did not come
            self._track(frame)
            self._next = frame.number + 1

    def skip(self, number: int) -> None:
        """The next frame that came is damaged: it has its number, and is not measured."""
        if number == self._next:
            self._next = number + 1

    def finish(self, asked: Finish, require_wanted: Callable[[], None] = lambda: None) -> LiveDone:
        """End: wait for what is under way, and measure from the run file what did not come.

        ``require_wanted`` is called with each frame, and raises when nobody waits for it any more.
        """
        if asked.run is None:
            self._begin_when_told(ended=True)  # else the run file knows better which frames are the reference
        self._drained()
        caught_up = 0
        if asked.run is not None:
            with RunFile(asked.run) as run:
                caught_up = self._catch_up(run, require_wanted)
        frames = 0
        if self._writer is not None:
            frames = self._writer.frames_written
            self._writer.close()
        return LiveDone(frames, caught_up, self._pool.restarts)

    def close(self, reason: str, run: Path | None = None) -> None:
        """End everything; a results file that is not complete says why, and what its run is where that is known."""
        try:
            if self._tracking is not None:
                self._tracking.close()
            if self._results.ident is not None:
                self._under_way.put(None)
                self._results.join()
        finally:
            if self._writer is not None:
                _interrupt(self._writer, reason, run)
            self._linear_algebra.__exit__(None, None, None)

    def _begin_when_told(self, *, ended: bool) -> None:
        pressures = np.array([frame.pressure_kpa for frame in self._first])
        count = reference_count(pressures, self._setup.phase, ended=ended)
        if self._begun is not None or count is None:
            return
        taken = self._first[:count]
        self._begin([frame.images for frame in taken], [frame.number for frame in taken])
        waiting, self._first = self._first, []
        for frame in waiting:
            try:
                self._track(frame)
            except MemoryFullError:
                self._next = frame.number  # it counts as one that did not come, and those after it
                return

    def _begin(self, taken: list[FrameImages], numbers: list[int]) -> None:
        setup = self._setup
        self._begun = begin(
            setup.calibration,
            self._source,
            taken,
            setup.phase,
            setup.settings,
            run_name=setup.run.file_name,
            warn=lambda text: self._tell(LiveWarning(text)),
            numbers=numbers,
        )
        header = self._begun.header(setup.title, setup.run, setup.calibration_name)
        self._writer = ResultsWriter(setup.out, header, flush_every=_FLUSH_EVERY)
        self._tracking = PooledTracking(self._pool, self._begun, chunk=CHUNK)
        if self._results.ident is None:
            self._results.start()

    def _begin_anew(self, run: RunFile) -> None:
        """Nothing that was measured counts."""
        assert self._tracking is not None and self._writer is not None  # noqa: S101 - begun
        self._tell(LiveWarning(f"{run.path}: its reference is another than it was live; all is measured once more"))
        self._tracking.close()
        self._writer.interrupt("its reference is not the run's")
        self._writer.path.unlink()
        self._begun = self._complete = self._writer = self._tracking = None

    def _track(self, frame: ArrivedFrame) -> None:
        assert self._tracking is not None  # noqa: S101 - begun
        self._tracking.put(frame.images)
        self._raise_failure()
        self._under_way.put(frame)
        self._raise_failure()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _drain(self) -> None:
        self._under_way.join()
        self._raise_failure()

    def _stand(self) -> _Complete:
        assert self._tracking is not None and self._begun is not None and self._writer is not None  # noqa: S101 - begun
        return _Complete(self._next, self._writer.frames_written, self._tracking.states(), self._begun.sequence.stray)

    def _drained(self) -> None:
        """Wait for all that is under way."""
        if self._tracking is None:
            return
        self._drain()
        if self._complete is None:
            self._complete = self._stand()

    def _take_results(self) -> None:
        while (frame := self._under_way.get()) is not None:
            try:
                if self._failure is None:
                    self._one_result(frame)
            except BaseException as error:  # raised where the next frame is pushed
                self._failure = error
            finally:
                self._under_way.task_done()
        self._under_way.task_done()

    def _one_result(self, frame: ArrivedFrame) -> None:
        assert self._tracking is not None and self._begun is not None  # noqa: S101 - begun
        measured = self._begun.sequence.combine(*self._tracking.take())
        self._hand_on(self._begun.result(frame.number, frame.time_s, frame.pressure_kpa, measured), frame.exposed_ns)

    def _hand_on(self, result: FrameResult, exposed_ns: int) -> None:
        assert self._writer is not None  # noqa: S101 - begun
        provisional = self._complete is not None and result.number >= self._complete.number
        if not provisional:
            self._writer.append(result)
        latency_s = (time.monotonic_ns() - exposed_ns) * 1e-9
        self._tell(thinned(result, self._writer.header.points_px, self._setup.event_points, latency_s, provisional))

    def _catch_up(self, run: RunFile, require_wanted: Callable[[], None]) -> int:
        """Name the run, and measure its frames that the results do not have; returns how many."""
        setup = self._setup
        choice = choose_frames(run, setup.phase, setup.settings.stereo, setup.calibration.jack_mm)
        if choice.left_out:
            self._tell(LiveWarning(f"{run.path}: {choice.left_out}"))
        numbers = [choice.numbers[place] for place in choice.reference]
        if self._begun is not None and self._begun.numbers != tuple(numbers):
            self._begin_anew(run)
        if self._begun is None:
            taken = [images_of(*pair) for pair in islice(frame_records(run, choice), len(numbers))]
            self._begin(taken, numbers)
            self._complete = self._stand()
        assert self._begun is not None and self._complete is not None and self._writer is not None  # noqa: S101 - begun
        self._writer.name_run(run.uuid, run.checksum)
        known = self._complete.frames
        needed = {number for state in self._complete.states for number in state.images} - {REFERENCE}
        earlier = {place: images for place, _, images in _at(run, choice, sorted(needed))}
        frames = _at(run, choice, range(known, len(choice)))
        self._begun.sequence.stray = self._complete.stray
        with PooledTracking(self._pool, self._begun, starts=self._complete.states, earlier=earlier) as tracking:
            done = 0
            if known < len(choice):
                self._tell(LiveCatchingUp(done, len(choice) - known))
            for (place, record), left, right in tracking.follow(((p, r), images) for p, r, images in frames):
                measured = self._begun.sequence.combine(left, right)
                require_wanted()
                number = choice.numbers[place]
                self._writer.append(self._begun.result(number, record.time_s, record.pressure_kpa, measured))
                done += 1
                self._tell(LiveCatchingUp(done, len(choice) - known))
        return done


def _interrupt(writer: ResultsWriter, reason: str, run: Path | None) -> None:
    """End results early; does nothing where they are complete."""
    if run is not None and not writer.header.run.uuid:
        with suppress(BscdError), RunFile(run) as named:
            writer.name_run(named.uuid, named.checksum)
    with suppress(BscdError):  # what keeps it from being written was told as the reason
        writer.interrupt(reason)


def _at(run: RunFile, choice: FrameChoice, places: Sequence[int]) -> Iterator[tuple[int, FrameRecord, FrameImages]]:
    for place, (primary, auxiliary) in zip(places, frame_records(run, choice, places), strict=True):
        yield place, primary, images_of(primary, auxiliary)


def _greatest(w_mm: FloatArray) -> float:
    known = w_mm[np.isfinite(w_mm)]
    return float(known.max()) if known.size else float("nan")


def thinned(result: FrameResult, points_px: FloatArray, most: int, latency_s: float, provisional: bool) -> LiveFrame:
    """A frame's event, with ``most`` points at most."""
    index = np.arange(0, len(result.status), max(-(-len(result.status) // most), 1))
    return LiveFrame(
        number=result.number,
        time_s=result.time_s,
        pressure_kpa=result.pressure_kpa,
        points=len(result.status),
        valid=int(np.count_nonzero(result.valid)),
        w_max_mm=_greatest(result.uvw_mm[result.valid, 2]),
        latency_s=latency_s,
        provisional=provisional,
        index=index,
        points_px=points_px[index],
        xyz_mm=result.xyz_mm[index],
        uvw_mm=result.uvw_mm[index],
        sigma_mm=result.sigma_mm[index],
        zncc=result.zncc[index],
        status=result.status[index],
    )
