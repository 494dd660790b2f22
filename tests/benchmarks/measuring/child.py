"""Measure a run in a process of its own, and print what it took as JSON: ``python -m ... FOLDER FRAMES ROUNDS``."""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.procedures.measuring import MeasureSettings, measure_to_file
from bscd.results import ResultsFile, count_points
from tests.benchmarks.measuring.stages import Stopwatch


def main() -> None:
    """Measure."""
    folder, frames, rounds = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    calibration = Calibration.load(folder / "cal.h5")
    told: dict[str, object] = {"wall_ms": [], "busy_ms": [], "stages_ms": []}
    with tempfile.TemporaryDirectory() as out:
        for number in range(rounds):
            path, watch = Path(out, f"{number}.h5"), Stopwatch()
            begun, busy = time.perf_counter(), _busy_s()
            with RunFile(folder / f"{frames}.h5") as run, watch.running():
                measure_to_file(calibration, run, path, MeasureSettings())
            per_frame = 1e3 / frames
            told["wall_ms"].append((time.perf_counter() - begun) * per_frame)
            told["busy_ms"].append((_busy_s() - busy) * per_frame)
            told["stages_ms"].append({name: s * per_frame for name, s in watch.wall_s.items()})
        told["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        with ResultsFile(path) as results:
            told["points"] = len(results.points_px)
            told["valid"] = count_points(results.frames()).valid / (frames * len(results.points_px))
    print(json.dumps(told))


def _busy_s() -> float:
    used = os.times()
    return used.user + used.system


if __name__ == "__main__":
    main()
