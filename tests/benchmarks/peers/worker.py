"""Correlates image pairs with one library, in a process and an environment of its own: ``worker.py LIBRARY THREADS``.

Reads a job a line from standard input (JSON: paths of the images and the points, subset_px, step_px, options,
answer), writes the displacements to the answer's path and says in a line of JSON what it took. Only the library's
call is timed: images and points are in memory before, displacements after. It imports nothing of this project.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from types import ModuleType
from typing import Any

import numpy as np

_WARM_UP_PX = 260


def main() -> None:
    library, threads = sys.argv[1], int(sys.argv[2])
    # libraries print what they like; answers go to the original standard output, prints to the errors
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    adapter = importlib.import_module(f"with_{library}")
    warm = False
    for line in sys.stdin:
        job = json.loads(line)
        try:
            if not warm:
                _warm_up(adapter, job, threads)
                warm = True
            answer = _work(adapter, job, threads)
        except Exception as err:
            answer = {"error": f"{type(err).__name__}: {err}".splitlines()[0]}
        print(json.dumps(answer), file=answers, flush=True)


def _work(adapter: ModuleType, job: dict[str, Any], threads: int) -> dict[str, float]:
    images = [np.load(job[which]) for which in ("reference", "current")]
    points = np.load(job["points"])
    begun = time.perf_counter()
    raw = adapter.correlate(*images, points, job, threads)
    seconds = time.perf_counter() - begun
    np.savez(job["answer"], **adapter.answer(raw, points, job))
    return {"seconds": seconds, "peak_mb": _peak_mb()}


def _warm_up(adapter: ModuleType, job: dict[str, Any], threads: int) -> None:
    """The same call on a corner of the images, so that what is compiled on first use is not timed."""
    images = [np.load(job[which])[:_WARM_UP_PX, :_WARM_UP_PX].copy() for which in ("reference", "current")]
    half, step = job["subset_px"] // 2, job["step_px"]
    line = np.arange(half, _WARM_UP_PX - half, step)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    adapter.correlate(*images, points, job, threads)


def _peak_mb() -> float:
    """Largest resident memory of this process; getrusage would give the parent's where that was larger."""
    with open("/proc/self/status") as status:
        (line,) = (line for line in status if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024.0


if __name__ == "__main__":
    main()
