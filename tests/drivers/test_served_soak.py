"""Ten minutes of an inflation over GigE Vision through the daemon, measured live: none lost, memory flat."""

from __future__ import annotations

import threading
from pathlib import Path

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


def resident_mb(process_id: int) -> float:
    """Of a process."""
    (line,) = (
        line for line in Path(f"/proc/{process_id}/status").read_text().splitlines() if line.startswith("VmRSS:")
    )
    return int(line.split()[1]) / 1024.0


def sampled(process_id: int, ended: threading.Event, into: list[float]) -> None:
    """Its memory every ten seconds."""
    while not ended.wait(10.0):
        into.append(resident_mb(process_id))


@pytest.mark.slow
@pytest.mark.own_network
@pytest.mark.timeout(1500)
def test_ten_minutes_over_gige_vision_with_live_results(tmp_path):
    require_aravis()
    # pressures in steps, since the twin takes longer for one that it has not rendered than a frame may
    config = configuration(tmp_path, changes={"pressure_step_kpa = 0.005": "pressure_step_kpa = 0.1"}, poll_s=1.0)
    (tmp_path / "data/calibrations").mkdir(parents=True)
    wide_calibration().save(tmp_path / "data/calibrations/wide.h5")
    inflation = {"ramp_s": RAMP_S, "hold_s": HOLD_S, "top_kpa": 4.0, "rest_frames": REST, "frame_rate_hz": RATE_HZ}
    memory_mb, ended = [], threading.Event()
    with serving(config, "--emulate") as served, Client(served.url) as client:
        idle(client)
        client.wait(client.submit({"recipe": "home"}).id)
        sampling = threading.Thread(target=sampled, args=(served.process.pid, ended, memory_mb))
        sampling.start()
        try:
            recipe = {"recipe": "inflation", "specimen": "membrane", "calibration": "wide", "inflation": inflation}
            job = client.wait(client.submit(recipe).id)
        finally:
            ended.set()
            sampling.join()
    settled_mb = memory_mb[round(SETTLED_S / 10.0)]
    grown_mb = max(memory_mb) - settled_mb
    print(job.figures, f"memory {settled_mb:.0f} MB, grown by {grown_mb:.1f} MB")
    planned = REST + round((RAMP_S + HOLD_S) * RATE_HZ)
    figures = job.figures
    assert (figures["frames"], figures["lost_frames"], figures["incomplete_frames"]) == (planned, 0, 0)
    assert grown_mb < 50.0
    with RunFile(tmp_path / "data/runs" / f"{job.outputs['run']}.h5") as run:
        assert run.complete
        assert (run.frames_acquired, run.losses) == (planned, ())
        assert (np.diff(run.table()["frame_id"]) == 1).all()
        assert run.verify() is None
    with ResultsFile(tmp_path / "data/results" / f"{job.outputs['result']}.h5") as results:
        assert results.complete
        assert len(results) == planned
