#!/usr/bin/env python3
"""Inflate the same membrane again and again, and print what each time gave.

Usage: scripts/examples/repeat_inflation.py [--times 3] [--top 2.0] [--calibration NAME] [--url http://127.0.0.1:8080]
"""

from __future__ import annotations

import argparse
from typing import Any

import bscd


def main() -> None:
    """Record, wait, tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=3, help="how often")
    parser.add_argument("--top", type=float, default=2.0, help="highest pressure, kPa")
    parser.add_argument("--ramp", type=float, default=3.0, help="duration of the ramp, s")
    parser.add_argument("--calibration", help="measure live with this calibration")
    parser.add_argument("--url", default="http://127.0.0.1:8080")
    given = parser.parse_args()
    recipe: dict[str, Any] = {
        "recipe": "inflation",
        "inflation": {"top_kpa": given.top, "ramp_s": given.ramp, "hold_s": 0.5, "rest_frames": 6},
    }
    if given.calibration:
        recipe["calibration"] = given.calibration
    with bscd.Client(given.url, operator="repeat_inflation.py") as rig, rig.control():
        for number in range(given.times):
            job = rig.wait(rig.submit(recipe).id)
            run, figures = job.outputs["run"], job.figures
            print(f"{number + 1} of {given.times}: {run}, {figures['frames']} frames, {figures['ending']}")


if __name__ == "__main__":
    main()
