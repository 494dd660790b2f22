"""The bound that is stated for the time base holds: against clocks whose true offset and delays are known."""

from dataclasses import replace

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.procedures.recording import InflationRecipe, record_inflation
from bscd.procedures.recording.clocks import ClockFit
from drivers.interfaces import Frame
from drivers.registry import DriverContext
from drivers.simulated import SimulatedCamera
from drivers.simulated.options import SimulatedCameraOptions
from drivers.twin.options import TwinOptions
from drivers.twin.world import World
from tests.procedures.test_recording import twin

__all__ = ["twin"]

PERIOD_S, EXPOSURE_S = 1.0 / 11.0, 0.02
IMAGE = np.zeros((2, 2), np.uint8)


def frame(true_ns, camera_ns, delay_s):
    """Exposed about a time of the host's clock; it arrives so long after its end."""
    return Frame(IMAGE, 0, round(camera_ns), round(true_ns + (EXPOSURE_S / 2.0 + delay_s) * 1e9))


@pytest.mark.parametrize("seed", range(12))
def test_every_mid_exposure_is_within_the_bound(seed):
    rng = np.random.default_rng(seed)
    readout_s, latency_s = rng.uniform(0.0, 1.5 * PERIOD_S), rng.choice([0.0, 0.003, 5.0])
    drift = rng.choice([-5e-5, 0.0, 5e-5])
    begun_ns, camera_began_ns = 3e9, rng.uniform(-1e15, 1e15)
    fit = ClockFit(EXPOSURE_S, None, 0.013, PERIOD_S)
    errors_s = []
    for number in range(1500):
        middle_ns = begun_ns + (latency_s + number * PERIOD_S + EXPOSURE_S / 2.0) * 1e9
        camera_ns = camera_began_ns + (middle_ns - begun_ns) * (1.0 + drift)
        taken = frame(middle_ns, camera_ns, readout_s + rng.exponential(0.003))
        errors_s.append((fit.middle_ns(taken, None if number else begun_ns) - middle_ns) * 1e-9)
    base = fit.result()
    early_s = np.abs(fit.early_s)
    assert np.abs(errors_s[15:]).max() <= base.uncertainty_s
    assert (np.abs(errors_s[:15]) <= base.uncertainty_s + early_s).all()
    # not by saying anything: the readout is within twice the bound, and the clocks drift
    assert base.uncertainty_s < 2.0 * PERIOD_S + abs(drift) * 1500 * PERIOD_S + 0.01


def test_the_asked_for_frames_of_software_pacing_narrow_it():
    fit = ClockFit(EXPOSURE_S, None, 0.013, PERIOD_S)
    for number, waited_s in enumerate((0.05, 0.002, 0.03)):
        asked_ns = number * 1e9
        middle_ns = asked_ns + (waited_s + EXPOSURE_S / 2.0) * 1e9
        fit.middle_ns(frame(middle_ns, middle_ns, 0.008), round(asked_ns))
    base = fit.result()
    assert abs(base.offset_ns) * 1e-9 <= base.uncertainty_s
    assert base.uncertainty_s == pytest.approx(0.005, abs=2e-6)  # half of 10 ms
    assert fit.early_s == pytest.approx([-0.008, 0.0, 0.0], abs=1e-6)


def test_a_known_readout_leaves_the_delays_alone():
    fit = ClockFit(EXPOSURE_S, 0.008, 0.013, PERIOD_S)
    for number, late_s in enumerate((0.0, 0.004, 0.001)):
        fit.middle_ns(frame(number * 1e9, number * 1e9, 0.008 + late_s))
    assert fit.result().offset_ns == 0
    assert fit.result().uncertainty_s == pytest.approx(0.001, abs=2e-6)


def test_without_frames_nothing_is_stated():
    assert ClockFit(EXPOSURE_S, None, 0.013, PERIOD_S).result() is None


@pytest.mark.parametrize("pacing", ["hardware", "software"])
@pytest.mark.parametrize("size_px", [(640, 512), (1280, 1024)])
def test_a_camera_whose_clock_is_the_host_s(twin, tmp_path, size_px, pacing):
    """The twin's camera stamps its frames with the host's clock, so the true offset is 0."""
    rig, options = twin.rig, TwinOptions()
    if size_px == (1280, 1024):
        assert (options.primary.width_px, options.primary.height_px) == size_px
        context = DriverContext("primary", twin.clock, World(options, clock=twin.clock))
        rig = replace(rig, primary=SimulatedCamera(SimulatedCameraOptions(), context))
        rig.primary.connect()
    recipe = InflationRecipe(rest_frames=3, ramp_s=0.2, hold_s=0.1, top_kpa=2.0, exposure_s=0.02, pacing=pacing)
    for readout_s, bound_s in ((None, 0.01), (0.01, 0.002)):
        path = tmp_path / f"{readout_s}.h5"
        record_inflation(rig, recipe.model_copy(update={"readout_s": readout_s}), path)
        with RunFile(path) as run:
            assert (run.cameras["primary"].width_px, run.cameras["primary"].height_px) == size_px
            assert abs(run.time_base.offset_ns) * 1e-9 <= run.time_base.uncertainty_s < bound_s
