"""Live results beside a recording: frames are handed to a process of lower priority, which may fall behind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from numpy.typing import NDArray

from bscd.dic.pool import MemoryFullError, SharedImage, WorkerLostError, end_program, start_program
from bscd.errors import BscdError
from bscd.procedures.live.messages import (
    Finish,
    LiveDone,
    LiveEvent,
    LiveFailure,
    LiveFrame,
    LiveReady,
    LiveSetup,
    PushedFrame,
    TakenFrame,
)

#: Images that may wait in memory for the live process, MB: 17 s of a 1.3 MP camera at 11 fps. The reference takes a
#: second or two to begin with, and what was recorded meanwhile as long again to be caught up with; one frame that is
#: missed costs measuring all after it once more.
WAITING_MB = 256.0

#: Once there is nothing to catch up it ends in this time; catching up has ``finish``'s own time-out.
_GRACE_S = 10.0
_LOOK_S = 0.5


class LiveMeasurement:
    """Measures frames that are pushed while they arrive; a context manager.

    ``on_event`` gets a `LiveFrame` for each map, and warnings and a failure, on a thread of this object's own; while it
    works events wait, and with them the measuring, but never the recording.
    """

    def __init__(
        self,
        setup: LiveSetup,
        on_event: Callable[[LiveEvent], None] = lambda _: None,
        *,
        waiting_mb: float = WAITING_MB,
    ) -> None:
        if setup.settings.stereo != "biprism":
            raise BscdError("live: only the biprism's views are measured while they arrive; use bscd measure")
        self._most_bytes, self._on_event = 1e6 * waiting_mb, on_event
        self._lock = threading.Condition()
        self._images: dict[str, SharedImage] = {}
        self._pushed = self._missed = 0
        self._latencies_s: list[float] = []
        self._done: LiveDone | None = None
        self._ready = False
        self._failure = ""
        self._process, self._pipe = start_program("bscd.procedures.live.process")
        self._pipe.send(setup)
        self._reader = threading.Thread(target=self._read, name="live events", daemon=True)
        self._reader.start()

    @property
    def pushed(self) -> int:
        """Frames that were handed over."""
        return self._pushed

    @property
    def missed(self) -> int:
        """Frames that were not, since too many waited or live measuring had failed; `finish` catches them up."""
        return self._missed

    @property
    def latencies_s(self) -> list[float]:
        """From exposure to map, of each live frame so far."""
        with self._lock:
            return list(self._latencies_s)

    @property
    def failure(self) -> str:
        """Why live measuring ended early, empty while it goes on."""
        return self._failure

    def wait_ready(self, timeout_s: float) -> bool:
        """Wait until the live process has loaded all and can follow; False when it has not, or has failed."""
        ends = time.monotonic() + timeout_s
        with self._lock:
            while not (self._ready or self._failure) and time.monotonic() < ends:
                self._lock.wait(_LOOK_S)
            return self._ready and not self._failure

    @property
    def process_id(self) -> int:
        """Of the live process."""
        return self._process.pid

    def push(
        self,
        number: int,
        frame: NDArray[Any],
        time_s: float,
        pressure_kpa: float,
        *,
        exposed_ns: int | None = None,
    ) -> bool:
        """Hand over a frame, without waiting; False when it was missed.

        ``number`` counts the frames to be measured from 0, with no gap but for those that were missed; ``exposed_ns``
        is when it was exposed by `time.monotonic_ns` (None: now). The image is copied.
        """
        exposed_ns = time.monotonic_ns() if exposed_ns is None else exposed_ns
        with self._lock:
            waiting = sum(image.nbytes for image in self._images.values())
            if self._failure or self._done or waiting + frame.nbytes > self._most_bytes:
                self._missed += 1
                return False
            try:
                image = SharedImage.holding(frame)
            except MemoryFullError:
                self._missed += 1
                return False
            self._images[image.name] = image
        try:
            self._pipe.send(PushedFrame(number, image, time_s, pressure_kpa, exposed_ns))
        except OSError:
            self._missed += 1  # the reader says why
            return False
        self._pushed += 1
        return True

    def finish(self, run: Path | None, timeout_s: float) -> LiveDone:
        """Wait until all is measured, also the frames that were missed, from the finished run file.

        Raises `BscdError` with the reason when live measuring failed, or is not done in ``timeout_s``; the run is whole
        either way, and ``bscd measure`` measures it.
        """
        if not self._failure:
            try:
                self._pipe.send(Finish(run))
            except OSError as error:
                raise WorkerLostError(
                    f"the live process is gone ({error}); measure the run with bscd measure"
                ) from error
        ends = time.monotonic() + timeout_s
        with self._lock:
            while self._done is None and not self._failure:
                if time.monotonic() > ends:
                    raise BscdError(f"live results are not done after {timeout_s:.0f} s; measure with bscd measure")
                self._lock.wait(_LOOK_S)
            if self._done is None:
                raise BscdError(
                    f"live measuring failed: {self._failure}; the run is whole, measure it with bscd measure"
                )
            return self._done

    def close(self) -> None:
        """End the live process; results that are not complete stay readable."""
        self._process_ends()
        self._reader.join()
        with self._lock:
            images = list(self._images.values())
            self._images.clear()
        for image in images:
            image.release()

    def _process_ends(self) -> None:
        if self._done is None and not self._failure:
            self._process.terminate()
        end_program(self._process, self._pipe, _GRACE_S)

    def _read(self) -> None:
        try:
            while True:
                self._take(self._pipe.recv())
        except (EOFError, OSError):
            with self._lock:
                if self._done is None and not self._failure:
                    self._failure = "the live process ended"
                self._lock.notify_all()

    def _take(self, message: Any) -> None:
        with self._lock:
            if isinstance(message, TakenFrame):
                self._images.pop(message.name).release()
                return
            if isinstance(message, LiveReady):
                self._ready = True
                self._lock.notify_all()
                return
            if isinstance(message, LiveFrame):
                self._latencies_s.append(message.latency_s)
            elif isinstance(message, LiveFailure):
                self._failure = message.text
            elif isinstance(message, LiveDone):
                self._done = message
            self._lock.notify_all()
        self._on_event(message)

    def __enter__(self) -> Self:
        """The measurement, whose process starts."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        self.close()
