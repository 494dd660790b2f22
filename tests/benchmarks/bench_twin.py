"""Time the digital twin: trace, rendering, serving. Run it as ``python tests/benchmarks/bench_twin.py``."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from drivers.twin.options import SceneName, TwinOptions
from drivers.twin.scene import render_scene
from drivers.twin.trace import trace_pixels
from drivers.twin.world import World


def median_ms(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median wall and processor time of a call in ms, after one call to warm up."""
    work()
    wall, busy = [], []
    for _ in range(repeats):
        start, start_busy = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - start)
        busy.append(time.process_time() - start_busy)
    return 1e3 * statistics.median(wall), 1e3 * statistics.median(busy)


def main() -> None:
    """Print a line for each measurement."""
    world = World(TwinOptions())
    optics, rng = world.optics("primary"), np.random.default_rng(0)
    columns, rows = np.meshgrid(np.arange(optics.width_px), np.arange(optics.height_px))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64)
    cube = world.state()
    raised = world.prism(cube)

    def render(scene: SceneName = "cube", **changes: float) -> Callable[[], object]:
        world.place(scene)
        state = world.state()._replace(**changes)
        prism = None if state.jack_mm < 10.0 else raised
        return lambda: render_scene(world.options, optics, prism, state)

    cases: list[tuple[str, Callable[[], object], int]] = [
        ("trace of a biprism frame", lambda: trace_pixels(optics, raised, pixels), 15),
        ("cube, corner pose, biprism", render(), 7),
        ("cube, face pose, biprism", render(rotation_deg=0.0), 7),
        ("cube, corner pose, direct", render(jack_mm=5.0), 7),
        ("sphere, biprism", render("sphere"), 5),
        ("membrane at 13 kPa, biprism", render("membrane", pressure_kpa=13.0), 5),
        ("dots of a biprism frame", lambda: world.dots("primary", cube), 5),
        ("exposure of a kept frame", lambda: world.expose("primary", exposure_s=0.02, gain_db=0.0, rng=rng), 15),
    ]
    for name, work, repeats in cases:
        wall, busy = median_ms(work, repeats)
        print(f"{name:32s} {wall:8.1f} ms wall {busy:8.1f} ms of processor")
    world.close()


if __name__ == "__main__":
    main()
