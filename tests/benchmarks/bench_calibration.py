"""How long a calibration of 3519 points takes, part by part: medians of several runs."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from bscd.calibration import CalibrationChoices, adjust_lattice, calibrate
from bscd.calibration.shifts import solve_shifts
from tests.calibration.exact_rig import ExactRig

REPEATS = 5


def median_s(work: Callable[[], object]) -> float:
    """Median wall time of several runs, after one that does not count."""
    work()
    times = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return statistics.median(times)


def main() -> None:
    """Print the table."""
    rig = ExactRig(noise_px=0.005)
    reference, bsc = rig.reference(), rig.bsc()
    made = calibrate(reference, bsc, rig.target, (1280, 1024))
    face = made.control.face_pose
    control = [a[face] for a in (made.control.left_px, made.control.right_px, made.control.reference_mm)]
    assert len(control[0]) == 3519
    matrices = (made.left.matrix, made.right.matrix)
    rows = [
        ("shifts of 3519 points, closed form", lambda: solve_shifts(*matrices, *control, "projection")),
        ("shifts of 3519 points, optimisation", lambda: solve_shifts(*matrices, *control, "smallest", "optimal")),
        ("the same, linear triangulation", lambda: solve_shifts(*matrices, *control, "smallest", "linear")),
        ("adjustment of the reference pair", lambda: adjust_lattice(reference, rig.target, (1280, 1024))),
        ("whole calibration from dots", lambda: calibrate(reference, bsc, rig.target, (1280, 1024)).shifts_px),
        ("maps, piecewise linear (tessellation)", lambda: made.choose("projection", "linear").maps),
        ("maps, smooth", lambda: made.choose("projection", "smooth").maps),
    ]
    views = [rig.view(side, "face", 1) for side in ("left", "right")]
    left, right = (np.tile(view.xy_px, (10, 1)) for view in views)
    for name in ("smooth", "linear"):
        ready = calibrate(reference, bsc, rig.target, (1280, 1024), CalibrationChoices(interpolant=name))
        rows.append((f"reconstruct 2070 points, {name} maps", lambda ready=ready: ready.reconstruct(left, right)))
    print(f"{'calibration':<42}{'ms (median)':>12}")
    for name, work in rows:
        print(f"{name:<42}{1e3 * median_s(work):>12.1f}")


if __name__ == "__main__":
    main()
