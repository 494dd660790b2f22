"""`bscd record` onto a disk that is small, fills, can not be written or goes away: on a real one, made for the test."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bscd.cli.live import BYTES_A_POINT, live_bytes
from bscd.procedures.measuring import MeasureSettings
from bscd.procedures.recording import InflationRecipe
from bscd.results.layout import QUANTITIES
from tests.cli.test_record import OPTIONS, ROOT, config
from tests.procedures.twin_rig import TwinRig

__all__ = ["config"]

FRAME_BYTES, FRAMES, RESERVE_BYTES = 320 * 256, 3 + 16, 64_000_000

#: The command; when the pressure rises something happens to its disk. Then what the regulator was asked for, what was
#: said, and what the run holds.
RECORDS = """
import contextlib, io, json, os, pathlib, shutil, sys
from functools import partial
import bscd.cli.record as command
from bscd.acquisition import RunFile, recover_in_place
from bscd.cli.app import run
from drivers.simulated import SimulatedPressure

what, folder, arguments = sys.argv[1], pathlib.Path(sys.argv[2]), sys.argv[3:]
path, asked = folder / "run.h5", []
set_pressure, vent = SimulatedPressure.set_pressure, SimulatedPressure.vent

def fill(to_leave):
    with open(folder / "other", "wb", buffering=0) as other, contextlib.suppress(OSError):
        while (free := shutil.disk_usage(folder).free) > to_leave:
            other.write(bytes(min(free - to_leave, 1_000_000)))

def happen():
    global path
    if what == "fills":
        fill(60_000_000)
    elif what == "full":
        fill(0)
    elif what == "gone":
        folder.rename(folder.with_name("elsewhere"))
        path = folder.with_name("elsewhere") / "run.h5"

def setting(self, kpa):
    set_pressure(self, kpa)
    asked.append(kpa)
    if kpa > 1.0 and not any(before > 1.0 for before in asked[:-1]):
        happen()

def venting(self):
    vent(self)
    asked.append(self.set_point_kpa())

SimulatedPressure.set_pressure, SimulatedPressure.vent = setting, venting
command.InflationRecipe = partial(command.InflationRecipe, rest_settle_s=0.5)
said = io.StringIO()
with contextlib.redirect_stderr(said):
    code = run(["record", str(path), *arguments])
if (folder / "other").exists():
    (folder / "other").unlink()
told = {"code": code, "asked": asked, "said": said.getvalue().splitlines()[-1:], "exists": path.exists()}
if path.exists():
    recovered = recover_in_place(path)
    with RunFile(path) as run:
        told |= {"state": run.state, "reason": run.reason, "frames": len(run.table()), "damage": recovered.damage}
        told |= {"acquired": run.frames_acquired, "lost": sum(loss.count for loss in run.losses)}
print(json.dumps(told))
"""


@pytest.fixture
def disk(tmp_path, config):
    """Runs the command on a new disk of so many bytes, on which something happens."""
    folder = tmp_path / "disk"
    folder.mkdir()

    def record(what, size_bytes, *more):
        mounted = f"mount -t tmpfs -o size={size_bytes} {' '.join(more)} tmpfs {folder}"
        if subprocess.run(["unshare", "-rm", "sh", "-c", mounted], capture_output=True).returncode:
            pytest.skip("the system lets nobody mount a small disk")
        inside = Path(folder, "runs") if what == "gone" else folder
        made = f'{mounted} && mkdir -p {inside} && exec "$@"'
        command = [sys.executable, "-c", RECORDS, what, inside, "--config", config, *OPTIONS]
        done = subprocess.run(
            ["unshare", "-rm", "sh", "-c", made, "sh", *command], capture_output=True, text=True, timeout=120, cwd=ROOT
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return record


def ended_vented(told):
    """It was under pressure, and the last that was asked for is none."""
    return max(told["asked"]) > 1.0 and told["asked"][-1] == 0.0


def test_one_without_room_for_all_frames_and_the_reserve_is_refused_before_anything_moves(disk):
    told = disk("nothing", RESERVE_BYTES + FRAMES * FRAME_BYTES - 100_000)
    assert told["code"] == 1
    assert "inflation refused, nothing moved: it needs 3 MB beside 64 MB that are kept free" in told["said"][0]
    assert set(told["asked"]) == {0.0}
    assert not told["exists"]


def test_one_with_just_so_much_room_takes_the_whole_run(disk):
    told = disk("nothing", RESERVE_BYTES + FRAMES * FRAME_BYTES + 1_200_000)
    assert (told["code"], told["state"], told["damage"]) == (0, "complete", "")
    assert told["acquired"] == told["frames"] + told["lost"] == FRAMES
    assert ended_vented(told)


def test_one_that_fills_to_its_reserve_ends_it_vented_and_closed(disk):
    told = disk("fills", 70_000_000)
    assert told["code"] == 1
    assert re.search(r"the disk is full \(6[0-3] MB left\)", told["said"][0])  # less than the reserve's 64
    assert (told["state"], told["damage"]) == ("interrupted", "")
    assert "the disk is full" in told["reason"]
    assert told["acquired"] == told["frames"] + told["lost"]
    assert told["frames"] > 3
    assert ended_vented(told)


def test_a_folder_that_goes_away_ends_it_vented(disk):
    told = disk("gone", 70_000_000)
    assert told["code"] == 1
    assert "its folder can not be reached any more" in told["said"][0]
    assert (told["state"], told["damage"]) == ("interrupted", "")
    assert told["frames"] >= 3
    assert ended_vented(told)


def test_one_that_can_not_be_written_is_refused_before_anything_moves(disk):
    told = disk("nothing", 70_000_000, "-o", "ro")
    assert told["code"] == 1
    assert "Read-only file system" in told["said"][0]
    assert set(told["asked"]) == {0.0}
    assert not told["exists"]


def test_room_for_live_results_is_asked_for_on_the_same_disk(tmp_path):
    bytes_a_point = sum(np.dtype(one.dtype).itemsize * int(np.prod(one.shape)) for one in QUANTITIES)
    assert abs(BYTES_A_POINT - bytes_a_point) <= 2
    rig, recipe = TwinRig().rig, InflationRecipe()
    settings = MeasureSettings(step_px=10)
    takes = live_bytes(rig, recipe, settings, tmp_path / "run.h5", tmp_path / "result.h5")
    assert takes == pytest.approx(recipe.frame_count * 640 * 512 / 400 * BYTES_A_POINT)
    assert live_bytes(rig, recipe, settings, tmp_path / "run.h5", Path("/proc/result.h5")) == 0


def test_one_without_any_room_left_ends_it_vented_and_can_be_recovered(disk):
    told = disk("full", 70_000_000)  # the reserve is gone too; closing a file that has no room ends HDF5's process
    assert told["code"] == 1
    assert "No space left on device" in told["said"][0]
    assert (told["state"], told["damage"]) == ("interrupted", "")  # with what was flushed, less than 1 s before
    assert ended_vented(told)
