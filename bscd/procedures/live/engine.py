"""Measure frames as they come, in the live process: reference first, then tracked on the pool, written and told."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from bscd.acquisition import FrameRecord, RunFile
from bscd.arrays import BoolArray, FloatArray
from bscd.dic.pool import LocalPool
from bscd.dic.tracker_state import REFERENCE, TrackerState
from bscd.errors import InputError
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
    """Up to where the results are those of all frames: what to go on from when the run file is there."""

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
        if self._begun is None:
            if frame.number != len(self._first):
                return  # the reference would not be the run's: all is left for the run file
            self._first.append(frame)
            self._begin_when_told(ended=False)
        else:
            self._track(frame)

    def finish(self, asked: Finish) -> LiveDone:
        """End: wait for what is under way, and measure from the run file what did not come."""
        if asked.run is None:
            self._begin_when_told(ended=True)  # else the run file knows better which frames are the reference
        live = self._drained()
        caught_up = 0
        if asked.run is not None:
            with RunFile(asked.run) as run:
                caught_up = self._catch_up(run, live)
                if self._writer is not None:
                    self._writer.name_run(run.uuid, run.checksum)
        if self._writer is not None:
            self._writer.close()
        return LiveDone(live + caught_up, caught_up, self._pool.restarts)

    def close(self, reason: str) -> None:
        """End everything; a results file that is not complete says why."""
        if self._tracking is not None:
            self._tracking.close()
        if self._results.ident is not None:
            self._under_way_put(None)
            self._results.join()
        if self._writer is not None:
            self._writer.interrupt(reason)
        self._linear_algebra.__exit__(None, None, None)

    def _begin_when_told(self, *, ended: bool) -> None:
        pressures = np.array([frame.pressure_kpa for frame in self._first])
        count = reference_count(pressures, self._setup.phase, ended=ended)
        if self._begun is not None or count is None:
            return
        self._begin([frame.images for frame in self._first[:count]])
        waiting, self._first = self._first, []
        for frame in waiting:
            self._track(frame)

    def _begin(self, taken: list[FrameImages]) -> None:
        setup = self._setup
        self._begun = begin(
            setup.calibration,
            self._source,
            taken,
            setup.phase,
            setup.settings,
            run_name=setup.run.file_name,
            warn=lambda text: self._tell(LiveWarning(text)),
        )
        header = self._begun.header(setup.title, setup.run, setup.calibration_name)
        self._writer = ResultsWriter(setup.out, header, flush_every=_FLUSH_EVERY)
        self._tracking = PooledTracking(self._pool, self._begun, chunk=CHUNK)
        self._results.start()

    def _track(self, frame: ArrivedFrame) -> None:
        assert self._tracking is not None  # noqa: S101 - begun
        if frame.number != self._next and self._complete is None:
            self._drain()
            self._complete = self._stand()
        self._next = frame.number + 1
        self._tracking.put(frame.images)
        self._under_way_put(frame)

    def _under_way_put(self, frame: ArrivedFrame | None) -> None:
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
        assert self._tracking is not None and self._begun is not None  # noqa: S101 - begun
        return _Complete(self._next, self._tracking.states(), self._begun.sequence.stray)

    def _drained(self) -> int:
        """After all that is under way: how many frames the results have."""
        if self._tracking is None:
            return 0
        self._drain()
        if self._complete is None:
            self._complete = self._stand()
        return self._complete.frames

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
        provisional = self._complete is not None and result.number >= self._complete.frames
        if not provisional:
            self._writer.append(result)
        latency_s = (time.monotonic_ns() - exposed_ns) * 1e-9
        self._tell(thinned(result, self._writer.header.points_px, self._setup.event_points, latency_s, provisional))

    def _catch_up(self, run: RunFile, known: int) -> int:
        """Measure the frames of a run from number ``known`` on; returns how many."""
        setup = self._setup
        choice = choose_frames(run, setup.phase, setup.settings.stereo, setup.calibration.jack_mm)
        if self._begun is None:
            self._begin([images_of(*pair) for pair in islice(frame_records(run, choice), len(choice.reference))])
            self._complete = self._stand()
        assert self._begun is not None and self._complete is not None and self._writer is not None  # noqa: S101 - begun
        if choice.reference != self._begun.numbers:
            raise InputError(
                f"{run.path}: its reference are frames 0 to {len(choice.reference) - 1}, live it was 0 to "
                f"{len(self._begun.numbers) - 1}, since pressures came late; measure it with bscd measure"
            )
        needed = {number for state in self._complete.states for number in state.images} - {REFERENCE}
        earlier = {number: images for number, _, images in _numbered(run, choice, sorted(needed))}
        frames = _numbered(run, choice, range(known, len(choice)))
        self._begun.sequence.stray = self._complete.stray
        with PooledTracking(self._pool, self._begun, starts=self._complete.states, earlier=earlier) as tracking:
            done = 0
            for (number, record), left, right in tracking.follow(((n, r), images) for n, r, images in frames):
                measured = self._begun.sequence.combine(left, right)
                self._writer.append(self._begun.result(number, record.time_s, record.pressure_kpa, measured))
                done += 1
                self._tell(LiveCatchingUp(done, len(choice) - known))
        return done


def _numbered(
    run: RunFile, choice: FrameChoice, which: Sequence[int]
) -> Iterator[tuple[int, FrameRecord, FrameImages]]:
    for number, (primary, auxiliary) in zip(which, frame_records(run, choice, which), strict=True):
        yield number, primary, images_of(primary, auxiliary)


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
