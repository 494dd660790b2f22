"""An inflation through the real GigE Vision driver, whose camera loses its power in the middle and comes back."""

import time
from dataclasses import replace

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.procedures import Rig
from bscd.procedures.recording import InflationRecipe, record_inflation
from drivers.clock import HostClock
from drivers.registry import DriverContext
from drivers.simulated import SimulatedAxis, SimulatedPressure
from drivers.simulated.options import JackOptions, RotationOptions, SimulatedPressureOptions, TranslationOptions
from tests.drivers.gige_rig import open_camera, serving, small_world

pytestmark = pytest.mark.own_network

RECIPE = InflationRecipe(
    rest_frames=5, ramp_s=3.0, hold_s=1.0, top_kpa=8.0, exposure_s=0.005, frame_rate_hz=20.0, rest_settle_s=0.5
)


@pytest.fixture
def rig():
    world = small_world()
    world.place("membrane")

    def context(name):
        return DriverContext(name, HostClock(), world)

    with serving(world) as emulator, open_camera(stall_timeout_s=0.5, reconnect_s=[0.2, 1.0]) as camera:
        rig = Rig(
            primary=camera,
            auxiliary=None,
            rotation=SimulatedAxis(RotationOptions(homed_at_start=True), context("rotation")),
            translation=SimulatedAxis(TranslationOptions(homed_at_start=True), context("translation")),
            jacks=SimulatedAxis(JackOptions(homed_at_start=True), context("jacks")),
            pressure=SimulatedPressure(SimulatedPressureOptions(), context("pressure")),
            clock=HostClock(),
            origin_mm=50.0,
            raised_mm=70.0,
            lowered_mm=5.0,
        )
        rig.connect()
        rig = replace(rig, raised_mm=rig.jacks.status().position)
        yield rig, emulator
        rig.close()
    world.close()


def test_a_power_cycle(rig, tmp_path):
    rig, emulator = rig
    ahead_ns = time.time_ns() - time.monotonic_ns()  # the emulated camera stamps by the wall clock

    cycled = []

    def cycle(progress):
        if progress.done >= 20 and not cycled:
            cycled.append(progress.done)
            emulator.power_cycle()

    done = record_inflation(rig, RECIPE, tmp_path / "i.h5", progress=cycle)
    assert done.lost_frames > 0
    assert done.frames + done.lost_frames == RECIPE.frame_count
    assert rig.pressure.set_point_kpa() == 0.0
    with RunFile(done.path) as run:
        table, base = run.table(), run.time_base
        assert run.verify() is None
        assert sum(loss.count for loss in run.losses) == done.lost_frames
        assert any("laid on the host's anew" in event.text for event in run.events)
        assert abs(base.offset_ns + ahead_ns) * 1e-9 <= base.uncertainty_s < 1.0
        true_ns = table["camera_time_ns"] - ahead_ns
        assert np.abs(table["time_s"] - (true_ns - true_ns[0]) * 1e-9).max() <= 2.0 * base.uncertainty_s
        assert (np.diff(table["time_s"]) > 0.0).all()
        log_ns, log_kpa = run.pressure_log()
        steepest_kpa_s = 8.0
        wrong_kpa = np.abs(table["pressure_kpa"] - np.interp(true_ns, log_ns, log_kpa))
        assert wrong_kpa.max() < base.uncertainty_s * steepest_kpa_s + 0.02
