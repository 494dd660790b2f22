"""The recorder: every frame of a ring into a run file, in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial

from bscd.acquisition.names import RECORDER
from bscd.acquisition.stream.losses import FrameAccount
from bscd.acquisition.stream.ring import FrameRing
from bscd.acquisition.stream.subscription import Keep
from bscd.acquisition.writer import RunWriter
from bscd.errors import BscdError
from drivers.interfaces import PressureReading

#: Longest time that frames wait for a flush when no more come.
_IDLE_S = 1.0


class Recorder:
    """Writes what comes through a ring; between `start` and `finish` nobody else may use the writer.

    When writing fails `failure` says why; the frames that come after it are counted as lost for that reason, and the
    source goes on until whoever runs it looks.

    Parameters
    ----------
    writer
        An open run that the frames fit; it stays open.
    ring
        Where the frames come from; subscribe before the first is published.
    account
        Where frames are counted as lost that came through the ring and are not in the file.
    """

    def __init__(self, writer: RunWriter, ring: FrameRing, account: FrameAccount) -> None:
        self._writer = writer
        self._ring = ring
        self._account = account
        self._frames = ring.subscribe(RECORDER, Keep.ALL)
        self._notes: deque[Callable[[], None]] = deque()
        self._handled = 0
        self._progress = threading.Condition()
        self._last_flush_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self.failure: BscdError | None = None

    def start(self) -> None:
        """Begin to write."""
        self._thread.start()

    def log_pressure(self, reading: PressureReading) -> None:
        """Add a reading to the run's pressure log, with the next frame."""
        self._notes.append(lambda: self._writer.log_pressure(reading))

    def event(self, text: str, at: str = "") -> None:
        """Keep a remark with the time of now, or another (`RunWriter.time_text`), with the next frame."""
        at = at or self._writer.time_text()
        self._notes.append(lambda: self._writer.event(text, at))

    def wait_idle(self, timeout_s: float) -> None:
        """Wait until everything published is written. Raises `BscdError` when that takes longer."""
        with self._progress:
            if not self._progress.wait_for(lambda: self._handled >= self._frames.counts().offered, timeout_s):
                raise BscdError(f"{self._writer.path}: the disk took no frame for {timeout_s:g} s; look what is wrong")

    def finish(self, timeout_s: float) -> None:
        """Write what waits in the ring, which has ended, and stop the thread; does nothing when stopped.

        Raises `BscdError` when the disk takes longer; the file is then left as by a crash, since it can not be closed.
        """
        self._ring.end()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        if self._thread.is_alive():
            self._writer.leave()
            raise BscdError(
                f"{self._writer.path}: the disk did not take the last frames within {timeout_s:g} s; look what is "
                "wrong with it, then restore what it has with bscd recover"
            )

    def _run(self) -> None:
        while not self._frames.ended:
            lease = self._frames.take(0.1)
            if lease is None:
                self._write(self._flush_if_due)
                continue
            with lease:
                self._write(partial(self._writer.append, lease.record))
                if self.failure is not None:
                    self._account.lose(lease.number, f"not written: {self.failure}")
            with self._progress:
                self._handled += 1
                self._progress.notify_all()
        self._write(lambda: None)  # the last remarks

    def _write(self, what: Callable[[], None]) -> None:
        """The remarks so far, then ``what``; the first failure is kept and nothing is written after it."""
        if self.failure is not None:
            return
        try:
            while self._notes:
                self._notes.popleft()()
            what()
        except BscdError as error:
            self.failure = error
        except Exception as error:  # whoever runs the recording has to vent, whatever this was
            self.failure = BscdError(f"{self._writer.path}: writing failed ({error!r})")

    def _flush_if_due(self) -> None:
        if self._writer.unflushed and time.monotonic() - self._last_flush_s > _IDLE_S:
            self._writer.flush()
            self._last_flush_s = time.monotonic()
