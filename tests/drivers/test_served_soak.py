"""Ten minutes of an inflation over GigE Vision through the daemon, also measured live: none lost, memory flat."""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.client import Client
from bscd.results import ResultsFile
from tests.api.serving import configuration, idle, serving
from tests.drivers.gige_rig import require_aravis
from tests.procedures.measuring.twin_runs import wide_calibration

RATE_HZ, RAMP_S, HOLD_S, REST = 11.0, 20.0, 580.0, 24
SETTLED_S = 60.0
"""The ramp's frames are rendered and kept meanwhile; what grows after that would grow for hours."""


@dataclass(frozen=True)
class Soaked:
    """What came of ten minutes: the job's figures, and the memory of all the daemon's processes together."""

    planned: int
    figures: dict[str, Any]
    settled_mb: float
    grown_mb: float
    run: Path
    results: Path | None


def processes(of: int) -> list[int]:
    """A process and all that it began, and they."""
    parents: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    family = [of]
    for each in family:
        family += [one for one, parent in parents.items() if parent == each]
    return family


def memory_mb(process_id: int) -> float:
    """Of a process and those that it began, each one's share of what several have mapped."""
    total_kb = 0.0
    for each in processes(process_id):
        with suppress(OSError):  # it has ended
            rolled_up = Path(f"/proc/{each}/smaps_rollup").read_text().splitlines()
            total_kb += sum(int(line.split()[1]) for line in rolled_up if line.startswith("Pss:"))
    return total_kb / 1024.0


def sampled(process_id: int, ended: threading.Event, into: list[float]) -> None:
    """Its memory every ten seconds."""
    while not ended.wait(10.0):
        into.append(memory_mb(process_id))


def soaked(folder: Path, *, live: bool, hold_s: float = HOLD_S) -> Soaked:
    """Serve, record, and measure live where that is wanted."""
    # pressures in steps, since the twin takes longer for one that it has not rendered than a frame may
    config = configuration(folder, changes={"pressure_step_kpa = 0.005": "pressure_step_kpa = 0.1"}, poll_s=1.0)
    (folder / "data/calibrations").mkdir(parents=True)
    wide_calibration().save(folder / "data/calibrations/wide.h5")
    inflation = {"ramp_s": RAMP_S, "hold_s": hold_s, "top_kpa": 4.0, "rest_frames": REST, "frame_rate_hz": RATE_HZ}
    recipe: dict[str, Any] = {"recipe": "inflation", "specimen": "membrane", "inflation": inflation}
    taken_mb: list[float] = []
    ended = threading.Event()
    with serving(config, "--emulate") as served, Client(served.url) as client:
        idle(client)
        client.wait(client.submit({"recipe": "home"}).id)
        sampling = threading.Thread(target=sampled, args=(served.process.pid, ended, taken_mb))
        sampling.start()
        try:
            job = client.wait(client.submit(recipe | ({"calibration": "wide"} if live else {})).id)
        finally:
            ended.set()
            sampling.join()
    settled_mb = taken_mb[min(round(SETTLED_S / 10.0), len(taken_mb) - 1)]
    return Soaked(
        planned=REST + round((RAMP_S + hold_s) * RATE_HZ),
        figures=job.figures,
        settled_mb=settled_mb,
        grown_mb=max(taken_mb) - settled_mb,
        run=folder / "data/runs" / f"{job.outputs['run']}.h5",
        results=folder / "data/results" / f"{job.outputs['result']}.h5" if "result" in job.outputs else None,
    )


@pytest.mark.slow
@pytest.mark.own_network
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("live", [False, True], ids=["recorded", "measured live"])
def test_ten_minutes_over_gige_vision(tmp_path, live):
    require_aravis()
    done = soaked(tmp_path, live=live)
    figures = done.figures
    print(figures, f"memory {done.settled_mb:.0f} MB, grown by {done.grown_mb:.1f} MB")
    assert (figures["frames"], figures["lost_frames"], figures["incomplete_frames"]) == (done.planned, 0, 0)
    assert done.grown_mb < 50.0
    with RunFile(done.run) as run:
        assert run.complete
        assert (run.frames_acquired, run.losses) == (done.planned, ())
        assert (np.diff(run.table()["frame_id"]) == 1).all()
        assert run.verify() is None
    assert (done.results is not None) == live
    if done.results is not None:
        assert figures["caught_up_frames"] == 0
        with ResultsFile(done.results) as results:
            assert results.complete
            assert len(results) == done.planned
