"""The paper's two scans through the real drivers, against the emulated rig: bytes instead of function calls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.composition import build_devices, build_world
from bscd.composition.emulated import emulated_devices, real_configuration
from bscd.config import RigConfig, parse_config
from bscd.procedures import Rig, ScanRecipe, calibrate_runs, home, record_scan
from drivers.clock import Clock, HostClock, VirtualClock
from drivers.emulators.rig import EmulatedRig
from tests.drivers.gige_rig import require_aravis

TWIN = Path(__file__).parents[2] / "config/twin.toml"

#: So that moves in real time take no longer than they must.
FAST = {
    'quantity = "rotation"': "speed_deg_s = 90.0\nacceleration_deg_s2 = 360.0\nhoming_speed_deg_s = 90.0",
    'quantity = "translation"': "speed_mm_s = 50.0\nacceleration_mm_s2 = 150.0\nhoming_speed_mm_s = 50.0",
    'quantity = "jack"': "speed_mm_s = 20.0\nacceleration_mm_s2 = 80.0\nhoming_speed_mm_s = 20.0",
}


def fast_twin() -> str:
    text = TWIN.read_text(encoding="utf-8")
    for line, more in FAST.items():
        text = text.replace(line, f"{line}\n{more}")
    return text


def rig_of(config: RigConfig, clock: Clock, devices: dict) -> Rig:
    return Rig(
        **devices,
        clock=clock,
        origin_mm=config.scan.origin_mm,
        raised_mm=config.prism.raised_mm,
        lowered_mm=config.prism.lowered_mm,
    )


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
def through_drivers(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    require_aravis()
    config, clock = parse_config(fast_twin()), HostClock()
    world = build_world(config, clock)
    emulated = EmulatedRig(emulated_devices(config, clock, world, "ximc"), first_port=None)
    try:
        assert emulated.start() == []
        real = parse_config(real_configuration(fast_twin(), emulated.configuration()))
        assert {section.driver for section in dict(real.devices).values()} == {
            "camera.aravis",
            "axis.ximc",
            "axis.modbus",
            "pressure.labjack_t7",
        }
        rig = rig_of(real, clock, build_devices(real, clock))
        return scanned(rig, real, tmp_path_factory.mktemp("drivers") / "scans")
    finally:
        emulated.stop()
        world.close()


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
def test_the_scans_give_the_calibration_of_the_simulated_rig(through_drivers: Calibration, in_process: Calibration):
    control = in_process.control
    one, other = (which.reconstruct(control.left_px, control.right_px) for which in (through_drivers, in_process))
    apart = (one.xyz_mm - other.xyz_mm)[one.inside & other.inside]
    assert len(apart) > 3000
    noise = np.median(other.sigma_mm, axis=0)  # of a dot; the calibrations average over hundreds
    assert (np.sqrt(np.mean(apart**2, axis=0)) < noise).all()
    for name in ("standard_stereo_error_mean_mm", "map_residual_rms_px"):
        assert through_drivers.figures[name] == pytest.approx(in_process.figures[name], rel=0.1)
