"""How long each stage of measuring takes: the functions that do it, wrapped with a stopwatch."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from bscd.analysis.surface import StrainGauge
from bscd.dic.tracking import Tracker
from bscd.procedures.measuring import measure as measuring
from bscd.procedures.measuring.geometry import BiprismGeometry
from bscd.procedures.measuring.views import BiprismSplitter
from bscd.results import ResultsWriter

#: Stage -> where its function is.
STAGES: dict[str, list[tuple[Any, str]]] = {
    "preparing the views": [(BiprismSplitter, "views")],
    "tracking, both views": [(Tracker, "track")],
    "triangulation": [(BiprismGeometry, "locate")],
    "covariance": [(BiprismGeometry, "describe"), (BiprismGeometry, "displacement_sigma_mm")],
    "strain": [(StrainGauge, "measure")],
    "writing": [(ResultsWriter, "append")],
}


class Stopwatch:
    """Seconds by stage, wall and of the calling thread's processor time; stages may run in several threads at once."""

    def __init__(self) -> None:
        self.wall_s: dict[str, float] = {"reading": 0.0, **dict.fromkeys(STAGES, 0.0)}
        self._lock = threading.Lock()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Measure within the block."""
        with ExitStack() as patched:
            for stage, places in STAGES.items():
                for owner, name in places:
                    patched.enter_context(patch.object(owner, name, self._timed(stage, getattr(owner, name))))
            read = measuring.frame_records
            patched.enter_context(patch.object(measuring, "frame_records", lambda *given: self._drawn(read(*given))))
            yield

    def _add(self, stage: str, begun_s: float) -> None:
        with self._lock:
            self.wall_s[stage] += time.perf_counter() - begun_s

    def _timed(self, stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any, **named: Any) -> Any:
            begun_s = time.perf_counter()
            try:
                return work(*given, **named)
            finally:
                self._add(stage, begun_s)

        return timed

    def _drawn(self, frames: Iterator[Any]) -> Iterator[Any]:
        while True:
            begun_s = time.perf_counter()
            try:
                frame = next(frames)
            except StopIteration:
                return
            finally:
                self._add("reading", begun_s)
            yield frame
