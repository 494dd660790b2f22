"""Ten minutes of an inflation on the full-size twin, in real time: none lost, memory flat.

The twin takes twice a frame's time to render a pressure that it has not seen, so its pressures come in steps of 0.1 kPa
and all are rendered before: what is held to its word here is the way from the camera to the disk.
"""

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.cli.record import DEFAULT_CONFIG, rig_of
from bscd.config import parse_config
from bscd.procedures.recording import InflationRecipe, record_inflation
from tests.acquisition.stream.test_soak import resident_mb


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_ten_minutes_at_eleven_frames_a_second(tmp_path):
    recipe = InflationRecipe(ramp_s=20.0, hold_s=580.0, top_kpa=8.0, exposure_s=0.02, gain_db=0.0)
    text = DEFAULT_CONFIG.read_text()
    assert text.count("pressure_step_kpa = 0.005") == 1
    config = parse_config(text.replace("pressure_step_kpa = 0.005", "pressure_step_kpa = 0.1"))
    memory_mb = {}

    def sample(progress):
        if progress.done % 100 == 0:
            memory_mb[progress.done] = resident_mb()

    with rig_of(config, rest_kpa=recipe.rest_kpa) as rig:
        world = rig.primary.world
        world.prepare("primary", [world.state()._replace(pressure_kpa=0.1 * step) for step in range(82)])
        world.wait()
        done = record_inflation(rig, recipe, tmp_path / "run.h5", progress=sample)
    grown_mb = max(memory_mb.values()) - memory_mb[100]
    print(f"{done}, grown by {grown_mb:.1f} MB to {max(memory_mb.values()):.0f} MB")
    assert (done.frames, done.lost_frames, done.incomplete_frames) == (recipe.frame_count, 0, 0)
    assert grown_mb < 50.0
    with RunFile(done.path) as run:
        table = run.table()
        assert run.complete
        assert (run.frames_acquired, run.losses) == (recipe.frame_count, ())
        assert (np.diff(table["frame_id"]) == 1).all()
        assert np.isfinite(table["pressure_kpa"]).all()
        assert run.verify() is None
