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

RAMP_S, HOLD_S, REST = 20.0, 580.0, 24


def resident_mb(process_id: int) -> float:
    """Of a process."""
    (line,) = (
        line for line in Path(f"/proc/{process_id}/status").read_text().splitlines() if line.startswith("VmRSS:")
    )
    return int(line.split()[1]) / 1024.0


@pytest.mark.slow
@pytest.mark.own_network
@pytest.mark.timeout(1500)
def test_ten_minutes_over_gige_vision_with_live_results(tmp_path):
    require_aravis()
    # pressures in steps, since the twin takes longer for one that it has not rendered than a frame may
    config = configuration(tmp_path, changes={"pressure_step_kpa = 0.005": "pressure_step_kpa = 0.1"}, poll_s=1.0)
    (tmp_path / "data/calibrations").mkdir(parents=True)
    wide_calibration().save(tmp_path / "data/calibrations/wide.h5")
    inflation = {"ramp_s": RAMP_S, "hold_s": HOLD_S, "top_kpa": 4.0, "rest_frames": REST}
    memory_mb, ended = [], threading.Event()
    with serving(config, "--emulate") as served, Client(served.url) as client:
        idle(client)
        client.wait(client.submit({"recipe": "home"}).id)

        def sample():
            while not ended.wait(10.0):
                memory_mb.append(resident_mb(served.process.pid))

        sampling = threading.Thread(target=sample)
        sampling.start()
        try:
            recipe = {"recipe": "inflation", "specimen": "membrane", "calibration": "wide", "inflation": inflation}
            job = client.wait(client.submit(recipe).id)
        finally:
            ended.set()
            sampling.join()
    grown_mb = max(memory_mb[6:]) - memory_mb[6]
    print(job.figures, f"memory grown by {grown_mb:.1f} MB to {max(memory_mb):.0f} MB")
    planned = REST + round((RAMP_S + HOLD_S) * 11.0)
    figures = job.figures
    assert (figures["frames"], figures["lost_frames"], figures["incomplete_frames"]) == (planned, 0, 0)
    assert grown_mb < 50.0
    with RunFile(tmp_path / "data/runs" / f"{job.outputs['run']}.h5") as run:
        assert run.complete
        assert (run.frames_acquired, run.losses) == (planned, ())
        assert (np.diff(run.table()["frame_id"]) > 0).sum() >= planned - 2  # an id may wrap
        assert run.verify() is None
    with ResultsFile(tmp_path / "data/results" / f"{job.outputs['result']}.h5") as results:
        assert results.complete
        assert len(results) == planned
