"""A fresh process correlates without compiling anything: what is slow to start is not even imported."""

from __future__ import annotations

import json
import subprocess
import sys

PROGRAM = """
import json, sys
import numpy as np
from bscd.dic import correlate, grid_points

rows, columns = np.indices((80, 96))
def seen(u, v):
    x, y = columns - u, rows - v
    waves = sum(np.sin(0.5 * (x * np.cos(a) + y * np.sin(a)) + 9 * a * a) for a in np.linspace(0, 3, 12))
    return (128 + 15 * waves).astype(np.float32)
found = correlate(seen(0, 0), seen(0.3, -0.2), grid_points((80, 96), 9))
json.dump({
    "valid": int(found.valid.sum()),
    "points": len(found.valid),
    "off": float(np.abs(found.displacement_px - (0.3, -0.2)).max()),
    "modules": sorted(sys.modules),
}, sys.stdout)
"""


def test_a_fresh_process_needs_no_compiler():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120, check=True)
    told = json.loads(done.stdout)
    assert told["valid"] == told["points"] > 50
    assert told["off"] < 0.05
    slow = {"numba", "llvmlite", "matplotlib", "pandas", "torch", "jax", "h5py"}
    assert not slow & set(told["modules"])
