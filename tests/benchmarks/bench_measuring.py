"""How long ``bscd measure`` takes a frame, where the time goes, and that memory does not grow with the frames.

``scripts/bench measuring`` takes a minute; ``--rounds 9`` for steadier medians. On a loaded machine the processor time
is the figure to compare, and wall times only within one run.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.benchmarks.measuring.cases import FRAMES, prepared

ROUNDS = 5


def main() -> None:
    """Measure and print."""
    said = argparse.ArgumentParser(description=__doc__)
    said.add_argument("--rounds", type=int, default=ROUNDS, help="runs of the shorter case")
    rounds = said.parse_args().rounds
    folder = prepared()
    short, long = (measured(folder, frames, n) for frames, n in zip(FRAMES, (rounds, 1), strict=True))
    wall_ms = statistics.median(short["wall_ms"])
    print(f"| {FRAMES[0]} frames of {short['points']} points, step 10 | a frame | wanted |\n| --- | --- | --- |")
    print(f"| wall, median of {rounds} runs, ms | {wall_ms:.1f} | 90 |")
    print(f"| the fastest of them, ms | {min(short['wall_ms']):.1f} | |")
    print(f"| processor time, all threads, ms | {statistics.median(short['busy_ms']):.1f} | |")
    for stage in short["stages_ms"][0]:
        print(f"| {stage}, wall ms | {statistics.median(run[stage] for run in short['stages_ms']):.1f} | |")
    print(f"| points that are valid, % | {100.0 * short['valid']:.1f} | |")
    print(f"| memory, largest resident, {FRAMES[0]} / {FRAMES[1]} frames, MB | ", end="")
    print(f"{short['peak_mb']:.0f} / {long['peak_mb']:.0f} | the same |")
    print(f"\nload of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def measured(folder: Path, frames: int, rounds: int) -> dict[str, Any]:
    """What a child process told."""
    command = [sys.executable, "-m", "tests.benchmarks.measuring.child", str(folder), str(frames), str(rounds)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


if __name__ == "__main__":
    main()
