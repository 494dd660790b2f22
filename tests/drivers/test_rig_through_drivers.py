"""The paper's two scans and an inflation over HTTP, through the real drivers, on the emulated rig.

`bscd serve --emulate` and `bscd run`, with steps of the shipped campaign: nothing but HTTP and the devices' bytes. The
calibration is that of the same scans on the simulated rig, by function calls.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.client import Client
from bscd.composition import build_devices, build_world
from bscd.config import RigConfig, parse_config
from bscd.daemon.documents import JobDocument, JobStatus
from bscd.procedures import Rig, ScanRecipe, calibrate_runs, home, record_scan
from bscd.results import ResultsFile
from drivers.clock import Clock, VirtualClock
from drivers.twin.membrane import Membrane
from drivers.twin.options import TwinOptions
from tests.api.serving import configuration, idle, serving
from tests.drivers.fast_twin import TWIN, fast_twin
from tests.drivers.gige_rig import require_aravis
from tests.results.measured import same

#: One frame a position of one pose, for `scanned` as well.
QUICK = {
    "frames_per_position = 2": "frames_per_position = 1",
    'poses = ["face", "corner"]': 'poses = ["face"]',
    "settle_s = 0.2": "settle_s = 0.05",
}
SHIPPED = TWIN.parent / "campaigns/genovese2013.toml"


def rig_of(config: RigConfig, clock: Clock, devices: dict) -> Rig:
    return Rig(
        **devices,
        clock=clock,
        origin_mm=config.scan.origin_mm,
        raised_mm=config.prism.raised_mm,
        lowered_mm=config.prism.lowered_mm,
    )


def experiment(folder: Path, campaign: Path, changes: dict[str, str]) -> JobDocument:
    """Have a campaign done by `bscd serve --emulate` and `bscd run --follow`; its data are in ``folder``/data."""
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
        campaigns = [job for job in client.jobs(JobStatus.DONE) if job.recipe.recipe == "campaign"]
    assert len(campaigns) == 1
    return campaigns[0]


def scanned(rig: Rig, config: RigConfig, folder: Path) -> Calibration:
    """Home, both scans of 17 positions, and the calibration from their run files."""
    folder.mkdir()
    target = config.target.grid()
    rig.connect()
    try:
        home(rig)
        for kind in ("reference", "bsc"):
            recipe = ScanRecipe(
                kind=kind,
                positions=config.scan.positions,
                step_mm=config.scan.step_mm,
                frames_per_position=1,
                corner_rotation_deg=config.scan.corner_rotation_deg,
                face_rotation_deg=config.scan.face_rotation_deg,
                settle_s=0.05,
                exposure_s=config.scan.exposure_s,
                gain_db=config.scan.gain_db,
            )
            record_scan(rig, recipe, target, folder / f"{kind}.h5")
    finally:
        rig.close()
    with RunFile(folder / "reference.h5") as reference, RunFile(folder / "bsc.h5") as bsc:
        assert len(bsc.table("primary")) == 18
        return calibrate_runs(reference, bsc, target, config.calibration.choices())


@pytest.fixture(scope="module")
def over_http(tmp_path_factory: pytest.TempPathFactory) -> tuple[JobDocument, Path]:
    """The campaign's job, done, and the data folder."""
    folder = tmp_path_factory.mktemp("http")
    campaign = folder / "campaign.json"
    campaign.write_text(json.dumps(shortened(), default=str))
    return experiment(folder, campaign, QUICK), folder / "data"


def shortened() -> dict[str, Any]:
    """The shipped campaign without alignment, validation, sphere and report, its inflation of three seconds."""
    campaign = tomllib.loads(SHIPPED.read_text(encoding="utf-8"))
    steps = {step["name"]: step for step in campaign["steps"]}
    del steps["calibration"]["do"]["validation"]
    steps["inflation"]["do"]["inflation"] |= {"top_kpa": 4.0, "rest_frames": 6, "ramp_s": 1.5, "hold_s": 0.5}
    steps["measure"]["do"]["report"] = False
    kept = ("home", "reference", "bsc", "calibration", "inflation", "measure")
    return campaign | {"steps": [steps[name] for name in kept]}


@pytest.fixture(scope="module")
def in_process(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    config, clock = parse_config(fast_twin()), VirtualClock()
    world = build_world(config, clock)
    try:
        rig = rig_of(config, clock, build_devices(config, clock, world))
        return scanned(rig, config, tmp_path_factory.mktemp("simulated") / "scans")
    finally:
        world.close()


@pytest.mark.own_network
@pytest.mark.timeout(400)
def test_the_scans_give_the_calibration_of_the_simulated_rig(over_http, in_process: Calibration):
    job, data = over_http
    through_drivers = Calibration.load(data / "calibrations" / f"{job.outputs['calibration.calibration']}.h5")
    control = in_process.control
    one, other = (which.reconstruct(control.left_px, control.right_px) for which in (through_drivers, in_process))
    apart = (one.xyz_mm - other.xyz_mm)[one.inside & other.inside]
    assert len(apart) > 3000
    noise = np.median(other.sigma_mm, axis=0)  # of a dot; the calibrations average over hundreds
    assert (np.sqrt(np.mean(apart**2, axis=0)) < noise).all()
    for name in ("standard_stereo_error_mean_mm", "map_residual_rms_px"):
        assert through_drivers.figures[name] == pytest.approx(in_process.figures[name], rel=0.1)


@pytest.mark.own_network
@pytest.mark.timeout(400)
def test_the_inflation_is_whole_and_measured(over_http):
    job, data = over_http
    for name in ("reference", "bsc", "inflation"):
        with RunFile(data / "runs" / f"{job.outputs[f'{name}.run']}.h5") as run:
            assert run.complete
            assert run.verify() is None
            assert run.losses == ()
    figures = job.figures["inflation"]
    assert (figures["ending"], figures["lost_frames"], figures["incomplete_frames"]) == ("completed", 0, 0)
    live, after = (data / "results" / f"{job.outputs[name]}.h5" for name in ("inflation.result", "measure.result"))
    with ResultsFile(live) as one, ResultsFile(after) as other:
        assert len(one) == figures["frames"]
        assert all(same(mine, theirs) for mine, theirs in zip(one.frames(), other.frames(), strict=True))
        last = list(other.frames())[-1]
    assert last.valid.mean() > 0.8  # one pose's hull is narrower than the membrane
    centre = np.zeros((1, 2))
    membrane = Membrane(TwinOptions().membrane)
    top, rest = (membrane.positions(centre, kpa) for kpa in (last.pressure_kpa, 0.05))
    assert np.nanmax(last.uvw_mm[:, 2]) == pytest.approx(float(np.linalg.norm(top - rest)), abs=0.02)


@pytest.mark.slow
@pytest.mark.own_network
@pytest.mark.timeout(900)
def test_the_campaign_as_it_is_shipped(tmp_path: Path):
    job = experiment(tmp_path, SHIPPED, {})
    assert job.figures["calibration"]["validation_corrected_mean_mm"] < 0.005
    assert abs(job.figures["sphere"]["sphere_corrected_fixed_deviation_mean_mm"]) <= 5.6e-4
    assert job.figures["sphere"]["sphere_corrected_fixed_deviation_std_mm"] <= 0.012
    assert job.figures["inflation"]["lost_frames"] == 0
    assert (tmp_path / "data/reports" / job.outputs["measure.report"] / "report.html").is_file()
