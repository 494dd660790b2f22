"""The desk's process: takes one task from its pipe, does it, tells; a stop ends it between two steps."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.config import parse_target
from bscd.daemon.running.tasks import (
    CalibrateTask,
    DeskDone,
    DeskFailure,
    DeskTask,
    DeskWarning,
    MeasureTask,
)
from bscd.errors import BscdError
from bscd.offline.calibrate import calibrate_files
from bscd.offline.report import report_measurement
from bscd.procedures import ProcedureStoppedError, Progress, validate_run
from bscd.procedures.measuring import measure_to_file
from bscd.procedures.reporting.source import Source
from bscd.procedures.reporting.sphere import sphere_data
from bscd.results import ResultsFile

#: The recorder and the rig come first.
NICE = 5


class _Desk:
    """One task; ``tell`` takes messages for the daemon."""

    def __init__(self, tell: Callable[[Any], None]) -> None:
        self._tell = tell
        self.stop = threading.Event()

    def do(self, task: DeskTask) -> dict[str, Any]:
        return self._calibrate(task) if isinstance(task, CalibrateTask) else self._measure(task)

    def _progress(self, now: Progress) -> None:
        if self.stop.is_set():
            raise ProcedureStoppedError("stopped as asked")
        self._tell(now)

    def _warn(self, text: str) -> None:
        self._tell(DeskWarning(text))

    def _calibrate(self, task: CalibrateTask) -> dict[str, Any]:
        made = calibrate_files(task.reference, task.bsc, task.choices, progress=self._progress, warn=self._warn)
        made.save(task.out)
        figures: dict[str, Any] = {name: float(value) for name, value in made.figures.items()}
        if task.validation is not None:
            with RunFile(task.validation) as run:
                target = parse_target(run.config_text, f"{run.path}, configuration").target.grid()
                held = validate_run(made, run, target, progress=self._progress)
            for which in ("uncorrected", "corrected"):
                errors = held.error_mm(which)
                known = errors[~(errors != errors)]
                figures[f"validation_{which}_mean_mm"] = float(known.mean()) if known.size else math.nan
                figures[f"validation_{which}_std_mm"] = float(known.std()) if known.size else math.nan
            figures["validation_points"] = int(held.inside.sum())
        return figures

    def _measure(self, task: MeasureTask) -> dict[str, Any]:
        calibration = Calibration.load(task.calibration)
        warnings: list[str] = []

        def warn(text: str) -> None:
            warnings.append(text)
            self._warn(text)

        with RunFile(task.run) as run:
            measure_to_file(
                calibration,
                run,
                task.out,
                task.settings,
                calibration_name=task.calibration.name,
                progress=self._progress,
                warn=warn,
            )
            figures = _figures(task, calibration, run)
            if task.report is not None:
                self._tell(Progress(0, 1, "writing the report"))
                report_measurement(
                    calibration,
                    run,
                    task.out,
                    task.settings,
                    task.report,
                    warnings=warnings,
                    warn=self._warn,
                    progress=self._progress,
                )
        return figures


def _figures(task: MeasureTask, calibration: Calibration, run: RunFile) -> dict[str, Any]:
    with ResultsFile(task.out) as results:
        figures: dict[str, Any] = {"frames": len(results), "points": len(results.points_px)}
        last = results.frame(len(results) - 1)
        figures["valid_points_of_the_last_frame"] = int(last.valid.sum())
        w_mm = last.uvw_mm[last.valid, 2]
        known = w_mm[w_mm == w_mm]
        if known.size:
            figures["w_max_of_the_last_frame_mm"] = float(known.max())
        source = Source(results, run, calibration)
        if source.phase == "sphere":
            data = sphere_data(source, None, task.sphere_radius_mm)
            shapes = {} if data is None else {"uncorrected": data.before, "corrected": data.after}
            for name, shape in shapes.items():
                for kind in ("fixed", "free"):
                    fit = getattr(shape, kind, None)
                    if fit is not None:
                        figures[f"sphere_{name}_{kind}_radius_mm"] = float(fit.radius_mm)
                        figures[f"sphere_{name}_{kind}_deviation_mean_mm"] = float(fit.mean_mm)
                        figures[f"sphere_{name}_{kind}_deviation_std_mm"] = float(fit.std_mm)
        return figures


def serve(pipe: Connection) -> None:
    """Do the task that comes; ends with it, or when the daemon does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the daemon is interrupted, and asks this to end
    os.nice(NICE)
    lock = threading.Lock()

    def tell(message: Any) -> None:
        with lock:
            pipe.send(message)

    desk = _Desk(tell)
    task = pipe.recv()

    def listen() -> None:
        with suppress(EOFError, OSError):  # the daemon is gone: what was measured so far stays readable
            pipe.recv()
        desk.stop.set()

    threading.Thread(target=listen, name="orders", daemon=True).start()
    try:
        tell(DeskDone(desk.do(task)))
    except ProcedureStoppedError as error:
        tell(DeskFailure(str(error), stopped=True))
    except (BscdError, OSError, ValueError, ArithmeticError) as error:
        tell(DeskFailure(str(error) or type(error).__name__))


if __name__ == "__main__":
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, BrokenPipeError):
        sys.exit(1)
