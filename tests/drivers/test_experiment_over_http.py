"""The shipped campaign through `bscd serve --emulate` and `bscd run --follow`: over HTTP and wire protocols only."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bscd.acquisition import RunFile
from bscd.client import Client
from bscd.daemon.documents import JobDocument, JobStatus
from bscd.results import ResultsFile
from tests.api.serving import configuration, idle, serving
from tests.drivers.gige_rig import require_aravis

SHIPPED = Path(__file__).resolve().parents[2] / "config/campaigns/genovese2013.toml"

#: Five positions instead of seventeen, one frame each.
FEWER = {
    "positions = 17": "positions = 5",
    "step_mm = 2.0": "step_mm = 6.0",
    "frames_per_position = 2": "frames_per_position = 1",
    "settle_s = 0.2": "settle_s = 0.05",
}
SHORTER = {"top_kpa = 13.0": "top_kpa = 4.0", "rest_frames = 24": "rest_frames = 6", "ramp_s = 5.0": "ramp_s = 1.0"}


def experiment(folder: Path, campaign: Path, changes: dict[str, str]) -> JobDocument:
    """The campaign's job at its end; its files are in ``folder``/data."""
    require_aravis()
    config = configuration(folder, changes=changes, poll_s=0.5)
    with serving(config, "--emulate") as served, Client(served.url) as client:
        idle(client)
        drivers = {device.driver for device in client.devices().values()}
        assert drivers == {"camera.aravis", "axis.ximc", "axis.modbus", "pressure.labjack_t7"}
        followed = subprocess.run(
            [Path(sys.executable).with_name("bscd"), "run", campaign, "--follow"],
            env=os.environ | {"BSCD_URL": served.url, "COLUMNS": "200"},
            capture_output=True,
            text=True,
            timeout=800,
        )
        assert followed.returncode == 0, followed.stdout + followed.stderr + "".join(served.log)
        assert "step 10 of 10, measure" in followed.stderr
        campaigns = [job for job in client.jobs(JobStatus.DONE) if job.recipe.recipe == "campaign"]
    assert len(campaigns) == 1
    return campaigns[0]


def checked(job: JobDocument, data: Path) -> None:
    """Every file is whole, nothing was lost, and the figures are those of a measurement."""
    outputs, figures = job.outputs, job.figures
    for name in ("reference", "bsc", "between", "inflation", "sphere"):
        with RunFile(data / "runs" / f"{outputs[f'{name}.run']}.h5") as run:
            assert run.complete
            assert run.verify() is None
            assert sum(loss.count for loss in run.losses) == 0
    with ResultsFile(data / "results" / f"{outputs['measure.result']}.h5") as results:
        last = list(results.frames())[-1]
    assert last.valid.mean() > 0.8
    assert (data / "reports" / outputs["measure.report"] / "report.html").is_file()
    print(figures)


@pytest.mark.own_network
@pytest.mark.timeout(400)
def test_a_shortened_one(tmp_path: Path):
    campaign = tmp_path / "short.toml"
    text = SHIPPED.read_text(encoding="utf-8")
    for old, new in SHORTER.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    campaign.write_text(text)
    job = experiment(tmp_path, campaign, FEWER)
    checked(job, tmp_path / "data")


@pytest.mark.slow
@pytest.mark.own_network
@pytest.mark.timeout(900)
def test_as_it_is_shipped(tmp_path: Path):
    job = experiment(tmp_path, SHIPPED, {})
    checked(job, tmp_path / "data")
