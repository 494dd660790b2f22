"""`scripts/host/setup` prepares a computer for the rig's devices, says what is missing, and cleans up after itself."""

import re
import subprocess
from pathlib import Path

import pytest

HOST = Path(__file__).parents[1] / "scripts/host"


@pytest.fixture
def setup(tmp_path: Path):
    folders = {"BSCD_UDEV_DIR": str(tmp_path / "udev"), "BSCD_SYSCTL_DIR": str(tmp_path / "sysctl")}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [HOST / "setup", *arguments],
            env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", **folders},
            capture_output=True,
            text=True,
            timeout=30,
        )

    return run


def test_installs_says_so_and_removes(setup, tmp_path: Path):
    before = setup("--check")
    assert before.returncode == 1
    assert f"missing: {tmp_path}/udev/70-bscd.rules; run: sudo scripts/host/setup --install" in before.stdout
    for _ in range(2):
        assert setup("--install").returncode == 0
    assert (tmp_path / "udev/70-bscd.rules").read_text() == (HOST / "70-bscd.rules").read_text()
    assert "70-bscd.rules" not in setup("--check").stdout
    assert setup("--remove").returncode == 0
    assert not list(tmp_path.glob("*/*bscd*"))


def test_says_how_to_give_the_receive_buffer_what_it_needs(setup):
    allowed = int(Path("/proc/sys/net/core/rmem_max").read_text())
    assert ("sysctl -w net.core.rmem_max=16777216" in setup("--check").stdout) == (allowed < 16_777_216)


def test_without_a_word_it_explains(setup):
    told = setup()
    assert told.returncode == 2
    assert told.stdout.startswith("Prepare this computer")
    assert setup("--help").returncode == 0


def test_every_rule_matches_something_and_names_a_group():
    rules = [line for line in (HOST / "70-bscd.rules").read_text().splitlines() if line and not line.startswith("#")]
    assert len(rules) > 8
    for rule in rules:
        parts = rule.split(", ")
        assert all(re.fullmatch(r'[A-Z]+(\{\w+\})?(==|=)"[^"]+"', part) for part in parts), rule
        assert any(part.startswith("SUBSYSTEM==") for part in parts)
        assert any(part in ('GROUP="dialout"', 'GROUP="video"') for part in parts)
