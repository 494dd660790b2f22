"""`bscd record` on a small twin in real time, and `bscd recover`."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bscd.acquisition import RunFile, RunState
from bscd.cli.app import run as bscd

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """The twin with a sensor of 320 x 256."""
    text = (ROOT / "config/twin.toml").read_text()
    for old, new in (("width_px = 1280", "width_px = 320"), ("height_px = 1024", "height_px = 256")):
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("twin") / "small.toml"
    path.write_text(text.replace("pixel_size_mm = 0.0067", "pixel_size_mm = 0.0268"))
    return path


OPTIONS = ["--duration", "1.5", "--top", "4", "--rest-frames", "3"]


@pytest.fixture(scope="module")
def recorded(config, tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "run.h5"
    assert bscd(["record", str(path), "--config", str(config), *OPTIONS, "--compression", "bitshuffle-lz4"]) == 0
    return path


def test_it_tells_what_came_of_it(recorded):
    with RunFile(recorded) as run:
        assert run.complete
        assert run.frames_acquired == 3 + round(1.5 * 11)
        assert len(run.table()) + sum(loss.count for loss in run.losses) == run.frames_acquired
        assert "width_px = 320" in run.config_text
        assert run.verify() is None


def test_a_signal_ends_it_vented_and_readable(config, tmp_path):
    path = tmp_path / "run.h5"
    with subprocess.Popen(
        [Path(sys.executable).with_name("bscd"), "record", path, "--config", config, "--duration", "60"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | {"COLUMNS": "200"},
    ) as recording:
        assert recording.stderr is not None
        while not re.search(r"Inflation: \d+/\d+ frames", line := recording.stderr.readline()):
            assert line, "it ended by itself"
        recording.send_signal(signal.SIGINT)
        told = recording.stderr.read()
        assert recording.wait(60) == 1
    assert re.search(r"error: inflation: after frame \d+: stopped as asked", told)
    with RunFile(path) as run:
        assert run.state is RunState.INTERRUPTED
        assert "stopped as asked" in run.reason
        assert len(run.table()) + sum(loss.count for loss in run.losses) == run.frames_acquired


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--ramp", "20"], "a ramp of 20 s does not fit a duration of 6.5 s; change --ramp"),
        (["--top", "3", "--limit", "2"], "limit_kpa = 2 must not be below top_kpa = 3"),
        (["--top", "40"], "top_kpa = 40 kPa is outside the pressure source's 0 to 16 kPa"),
        (["--top", "inf"], "--top should be a finite number"),
        (["--duration", "20000"], "the hold (--duration less --ramp) should be less than or equal to 3600"),
        (["--duration", "6", "--ramp", "nan"], "a ramp of nan s does not fit a duration of 6 s; change --ramp"),
    ],
)
def test_what_can_not_be_is_told_in_a_line(config, tmp_path, capsys, options, told):
    assert bscd(["record", str(tmp_path / "run.h5"), "--config", str(config), *options]) == 1
    said = capsys.readouterr().err
    assert told in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "run.h5").exists()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"config": "nowhere.toml"}, "nowhere.toml: can not be read (No such file or directory); name a TOML file"),
        ({"config": "."}, "can not be read (Is a directory); name a TOML file"),
        (
            {"out": "nowhere/run.h5"},
            "nowhere can not be reached (No such file or directory); make it, or",
        ),
    ],
)
def test_a_path_that_can_not_be_is_told_with_what_to_do(config, tmp_path, capsys, change, told):
    places = {"out": "run.h5", "config": config} | change
    code = bscd(["record", str(tmp_path / places["out"]), "--config", str(tmp_path / places["config"])])
    said = capsys.readouterr().err
    assert code == 1
    assert told in said
    assert "Errno" not in said
    assert len(said.splitlines()) == 1


def test_a_duration_without_an_end_is_bad_usage(config, tmp_path, capsys):
    assert bscd(["record", str(tmp_path / "run.h5"), "--config", str(config), "--duration", "inf"]) == 2
    said = capsys.readouterr().err
    assert "--duration" in said
    assert "ramp_s" not in said


def test_recover_leaves_a_whole_run_and_makes_copies(recorded, tmp_path, capsys):
    before = recorded.read_bytes()
    assert bscd(["recover", str(recorded)]) == 0
    assert "it needed no recovery, all as recorded" in capsys.readouterr().out
    assert recorded.read_bytes() == before
    assert bscd(["recover", str(recorded), "--out", str(tmp_path / "copy.h5")]) == 0
    with RunFile(recorded) as run, RunFile(tmp_path / "copy.h5") as copy:
        assert len(copy.table()) == len(run.table())
        assert copy.time_base == run.time_base
        assert copy.losses == run.losses


def test_recover_tells_damage_and_what_to_do(recorded, tmp_path, capsys):
    path = tmp_path / "run.h5"
    shutil.copy(recorded, path)
    with RunFile(path) as run:
        kept = run.recorded(run.table()[4])[1].encode()
    with path.open("r+b") as file:
        file.seek(path.read_bytes().index(kept))
        file.write(b"0000")
    assert bscd(["recover", str(path)]) == 1
    assert "frame 4" in (said := capsys.readouterr().err)
    assert "--out COPY.h5" in said


def test_recover_refuses_what_is_no_run(tmp_path, capsys):
    (tmp_path / "x.h5").write_text("frames")
    assert bscd(["recover", str(tmp_path / "x.h5")]) == 1
    assert "is not an HDF5 file" in capsys.readouterr().err
