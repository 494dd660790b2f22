import subprocess
import sys
from pathlib import Path

import pytest

from bscd.cli.app import COMMANDS, run

ROOT = Path(__file__).resolve().parents[2]
BSCD = Path(sys.executable).with_name("bscd")


def test_version_and_exit_codes():
    done = subprocess.run([BSCD, "--version"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert done.stdout.startswith("bscd ")
    by_module = subprocess.run([sys.executable, "-m", "bscd", "--version"], capture_output=True, text=True, timeout=60)
    assert (by_module.returncode, by_module.stdout) == (0, done.stdout)


@pytest.mark.parametrize(("option", "unwanted"), [("--version", {"numpy"}), ("--help", {"matplotlib", "fastapi"})])
def test_what_is_asked_first_is_told_without_loading_all(option, unwanted):
    asked = (
        f"import sys; from bscd.cli.app import run; run([{option!r}]); sys.exit(bool({unwanted} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", asked], capture_output=True, timeout=60).returncode == 0


def test_good_and_bad_configuration(capsys, tmp_path):
    assert run(["config", "check", str(ROOT / "config/twin.toml")]) == 0
    assert "valid" in capsys.readouterr().out
    (tmp_path / "bad.toml").write_text("[rig]\nnmae = 'x'\n")
    assert run(["config", "check", str(tmp_path / "bad.toml")]) == 1
    error = capsys.readouterr().err
    assert "did you mean name?" in error
    assert "Traceback" not in error


def test_bad_usage(capsys):
    assert run(["config", "check"]) == 2
    assert run(["no-such-command"]) == 2
    assert run(["config", "check", "--no-such-option", "x"]) == 2


@pytest.mark.parametrize("command", [name for names in COMMANDS.values() for name in names])
def test_help_shows_an_example(command, capsys):
    run([command, "--help"])
    told = capsys.readouterr().out
    if command in ("config", "keys"):  # a group: its commands show theirs
        run([command, {"config": "check", "keys": "add"}[command], "--help"])
        told = capsys.readouterr().out
    assert f"bscd {command}" in told
    assert "Example" in told


def test_schema_is_json(capsys):
    import json

    assert run(["config", "schema"]) == 0
    assert "devices" in json.loads(capsys.readouterr().out)["properties"]
