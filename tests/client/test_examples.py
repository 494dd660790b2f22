"""The example scripts, as they are, against a served twin."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.api.serving import api_of
from tests.daemon.small import done, recipe, small_daemon, until

EXAMPLES = Path(__file__).resolve().parents[2] / "scripts/examples"


def start(name, *arguments):
    return subprocess.Popen(
        [sys.executable, EXAMPLES / name, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process):
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out


def test_an_inflation_again_and_again(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, requests_per_s=10_000.0) as daemon, api_of(daemon) as api:
        done(daemon, "home")
        arguments = ("--times", 2, "--top", 1, "--ramp", 0.5, "--url", api.base_url)
        told = ended(start("repeat_inflation.py", *arguments)).splitlines()
        assert [line.split(":")[0] for line in told] == ["1 of 2", "2 of 2"]
        assert all(line.endswith("frames, completed") for line in told)
        assert len(daemon.files.list("run")) == 2
        assert daemon.lease.document() is None


def test_a_rig_is_watched(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True) as daemon, api_of(daemon) as api:
        daemon.latest.put("primary", np.zeros((64, 64), np.uint8), 1, 1)
        job = daemon.submit(recipe("home", prompt="go?"), "test")
        watching = start("watch.py", "--folder", tmp_path, "--url", api.base_url)
        until(lambda: daemon.events._subscriptions and daemon.job(job.id).prompt, "the script follows it")
        daemon.stop_job(job.id, "test")
        assert ended(watching).startswith(f"{job.id}: home stopped")
        assert (tmp_path / f"{job.id}.jpg").read_bytes()[:2] == b"\xff\xd8"


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_each_explains_itself(script):
    assert "Usage: scripts/examples/" in ended(start(script.name, "--help"))
