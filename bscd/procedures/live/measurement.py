"""Live results beside a recording: frames are handed to a process of lower priority, which may fall behind."""

from __future__ import annotations

import math
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from numpy.typing import NDArray

from bscd.dic.pool import MemoryFullError, SharedImage, start_program
from bscd.errors import BscdError
from bscd.procedures.live.messages import (
    DamagedFrame,
    Finish,
    GiveUp,
    LiveDone,
    LiveEvent,
    LiveFailure,
    LiveFrame,
    LiveReady,
    LiveSetup,
    PushedFrame,
    TakenFrame,
)
from bscd.procedures.live.outbox import Outbox

#: Images that may wait in memory for the live process, MB: 17 s of a 1.3 MP camera at 11 fps. The reference takes a
#: second or two to begin with, and what was recorded meanwhile as long again to be caught up with; one frame that is
#: missed costs measuring all after it once more.
WAITING_MB = 256.0

#: However small they are, no more than these wait.
_MOST_WAITING = 256

#: The live process lends its workers images of its own while it follows: room for so many is left to it.
_LEFT_IMAGES = 16

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
        self._ready = self._ended = False
        self._failure = ""
        self._heard_s = 0.0
        self._process, self._pipe = start_program("bscd.procedures.live.process")
        self._outbox = Outbox(self._pipe)
        self._outbox.put(setup)
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

        ``number`` counts the frames as recorded from 0, with no gap but for those that were missed; ``exposed_ns`` is
        when it was exposed by `time.monotonic_ns` (None: now). The image is copied.
        """
        exposed_ns = time.monotonic_ns() if exposed_ns is None else exposed_ns
        with self._lock:
            if not self._has_room(frame.nbytes):
                self._missed += 1
                return False
            try:
                image = SharedImage.holding(frame, leave_bytes=_LEFT_IMAGES * frame.nbytes)
            except MemoryFullError:
                self._missed += 1
                return False
            self._images[image.name] = image
            self._outbox.put(PushedFrame(number, image, time_s, pressure_kpa, exposed_ns))
            self._pushed += 1
        return True

    def skip(self, number: int) -> None:
        """Say that a frame came damaged: it is recorded and not measured. Does not wait."""
        self._outbox.put(DamagedFrame(number))

    def finish(
        self,
        run: Path | None,
        timeout_s: float,
        *,
        most_s: float = math.inf,
        leave: Callable[[], str] = lambda: "",
    ) -> LiveDone:
        """Wait until all is measured, also the frames that were missed, from the finished run file.

        ``timeout_s`` counts from the last sign of progress, ``most_s`` from now. ``leave`` is asked all the while why
        the rest is to be left, "" when it is not.

        Raises `BscdError` with the reason when live measuring failed or was left; the run is whole either way, and
        ``bscd measure`` measures it.
        """
        with self._lock:
            self._ended = True
            begun_s = self._heard_s = time.monotonic()
            if not self._failure:
                self._outbox.put(Finish(run))
        while True:
            why = leave()
            with self._lock:
                if self._done is not None:
                    return self._done
                if self._failure:
                    told = f"live measuring failed: {self._failure}; the run is whole, measure it with bscd measure"
                    raise BscdError(told)
                now_s = time.monotonic()
                if not why and now_s - self._heard_s > timeout_s:
                    why = f"no frame was measured for {timeout_s:.0f} s"
                elif not why and now_s - begun_s > most_s:
                    why = f"more than {most_s:.0f} s to catch up"
                if why:
                    self._outbox.put_instead(GiveUp(why, run))
                    self._failure = why
                    raise BscdError(f"live results are not complete: {why}; measure the run with bscd measure")
                self._lock.wait(min(_LOOK_S, timeout_s, most_s))

    def close(self, reason: str = "it was ended before all was measured") -> None:
        """End the live process; results that are not complete stay readable, and say the reason."""
        with self._lock:
            self._ended = True
            if self._done is None and not self._failure:
                self._outbox.put_instead(GiveUp(reason))
            if self._done is None and not self._ready:
                self._process.terminate()  # it reads nothing while it loads
        try:
            self._process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(_GRACE_S)
        self._outbox.end(_GRACE_S)
        self._reader.join(_GRACE_S)
        self._pipe.close()
        with self._lock:
            images = list(self._images.values())
            self._images.clear()
        for image in images:
            image.release()

    def _has_room(self, nbytes: int) -> bool:
        """Whether one more image may wait."""
        if self._ended or self._failure or self._done is not None or len(self._images) >= _MOST_WAITING:
            return False
        return sum(image.nbytes for image in self._images.values()) + nbytes <= self._most_bytes

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
            self._heard_s = time.monotonic()
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
        """End it; what ended the block is the reason of results that are not complete."""
        if error is None:
            self.close()
        elif isinstance(error, Exception):
            self.close(str(error) or type(error).__name__)
        else:
            self.close("the program was asked to end")
