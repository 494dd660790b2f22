"""The service: its unit is right and hardened, and installing and removing it leaves what is not ours alone."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
UNIT = ROOT / "systemd/bscd.service"

analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze on this computer")


def run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=120)


@pytest.fixture
def unit(tmp_path):
    """The unit, its program where there is one."""
    path = tmp_path / "bscd.service"
    text = UNIT.read_text()
    assert "/opt/bscd/.venv/bin/bscd serve" in text
    path.write_text(text.replace("/opt/bscd/.venv/bin/bscd", "/bin/true"))
    return path


@analyze
def test_systemd_has_nothing_to_say_of_it(unit):
    told = run("systemd-analyze", "verify", unit)
    assert (told.returncode, told.stderr) == (0, "")


@analyze
def test_it_is_hardened(unit):
    told = run("systemd-analyze", "security", "--offline=true", unit)
    found = re.search(r"Overall exposure level for bscd\.service: ([0-9.]+)", told.stdout)
    assert found, told.stdout + told.stderr
    assert float(found[1]) <= 2.5


def test_it_notifies_is_watched_and_is_started_again():
    lines = UNIT.read_text().splitlines()
    assert {"Type=notify", "NotifyAccess=main", "Restart=on-failure"} <= set(lines)
    (watchdog,) = [line for line in lines if line.startswith("WatchdogSec=")]
    assert int(watchdog.split("=")[1]) >= 30


def files(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}


def test_installing_and_removing_under_a_folder(tmp_path):
    told = run(ROOT / "scripts/install", "--root", tmp_path)
    assert told.returncode == 0, told.stderr
    there = files(tmp_path)
    assert {
        "etc/bscd/rig.toml",
        "etc/systemd/system/bscd.service",
        "etc/udev/rules.d/70-bscd.rules",
        "etc/sysctl.d/60-bscd.conf",
        "opt/bscd/pyproject.toml",
        "opt/bscd/bscd/cli/app.py",
    } <= there
    assert not [name for name in there if "/.venv/" in name or "/.git/" in name]
    (tmp_path / "etc/bscd/rig.toml").write_text("mine")
    (tmp_path / "var/lib/bscd/run.h5").write_text("data")
    assert run(ROOT / "scripts/install", "--root", tmp_path).returncode == 0
    assert (tmp_path / "etc/bscd/rig.toml").read_text() == "mine"
    assert run(ROOT / "scripts/uninstall", "--root", tmp_path).returncode == 0
    assert files(tmp_path) == {"etc/bscd/rig.toml", "var/lib/bscd/run.h5"}


def test_a_dry_run_does_nothing_and_bad_usage_is_told(tmp_path):
    told = run(ROOT / "scripts/install", "--root", tmp_path / "x", "--dry-run")
    assert told.returncode == 0
    assert "+ install -D -m 644" in told.stdout
    assert not (tmp_path / "x").exists()
    told = run(ROOT / "scripts/install", "--turbo")
    assert (told.returncode, "is not known" in told.stderr) == (2, True)
    told = run(ROOT / "scripts/install", "--root", tmp_path, "--config", tmp_path / "none.toml")
    assert (told.returncode, "there is no such configuration" in told.stderr) == (1, True)
    assert run(ROOT / "scripts/install", "--help").stdout.startswith("Install bscd as a service")
