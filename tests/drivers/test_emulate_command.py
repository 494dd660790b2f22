"""`bscd emulate` and `bscd devices`: a rig behind its wire protocols, and what the real drivers say of it."""

from __future__ import annotations

import socket
import subprocess
import time
from pathlib import Path

import pytest

from drivers.emulators.rig import PORTS
from tests.drivers.emulate_process import BSCD, emulating, free_ports
from tests.drivers.gige_rig import require_aravis

pytestmark = pytest.mark.own_network


def devices(config: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(BSCD), "devices", "--config", str(config)], capture_output=True, text=True, timeout=120)


def test_everything_configured_answers(tmp_path: Path):
    require_aravis()
    config = tmp_path / "emulated.toml"
    with emulating(config) as emulation:
        lines = emulation.lines
        told = "\n".join(lines)
        for what in (
            "GigE Vision camera twin-primary",
            "GigE Vision camera twin-auxiliary",
            "rotation: Standa XIMC",
            "translation: Standa XIMC",
            "Zaber devices: rotation (1), translation (2)",
            "Modbus TCP, units 1 and 2",
            "Modbus RTU, units 1 and 2",
            "LabJack T7",
        ):
            assert what in told
        ports = [Path(line.split()[0]) for line in lines if line.startswith("/") and "serial" in line.split()[0]]
        assert len(ports) == 4
        assert all(port.exists() for port in ports)
        answered = devices(config)
        assert answered.returncode == 0, answered.stdout + answered.stderr
        assert answered.stdout.count("answers: ") == 6
        for what in (
            'serial = "twin-primary"',
            "camera.aravis        answers: bscd Twin primary",
            "axis.ximc            answers: Standa",
            "firmware 4.6.6",
            "firmware 1.0312",
            "axis.modbus          answers: Oriental Motor AZ",
            "pressure.labjack_t7  answers: LabJack T7",
            "not homed",
        ):
            assert what in answered.stdout
    assert not any(port.exists() for port in ports)
    begun = time.monotonic()
    gone = devices(config)
    assert time.monotonic() - begun < 60.0
    assert gone.returncode == 1
    assert gone.stdout.count("NO ANSWER: ") == 6
    assert "Traceback" not in gone.stdout + gone.stderr


def test_zaber_stages(tmp_path: Path):
    config = tmp_path / "emulated.toml"
    with emulating(config, "--stages", "zaber"):
        answered = devices(config).stdout
        assert "rotation     axis.zaber           answers: Zaber" in answered
        assert "translation  axis.zaber           answers: Zaber" in answered


def test_a_configuration_is_never_overwritten(tmp_path: Path):
    config = tmp_path / "mine.toml"
    config.write_text("mine")
    done = subprocess.run(
        [str(BSCD), "emulate", "--write-config", str(config)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "exists already" in done.stderr
    assert config.read_text() == "mine"


def test_a_port_that_is_taken_is_named(tmp_path: Path):
    first = free_ports()
    with socket.socket() as other:
        other.bind(("127.0.0.1", first + 1))
        other.listen()
        done = subprocess.run(
            [str(BSCD), "emulate", "--first-port", str(first)], capture_output=True, text=True, timeout=60
        )
    assert done.returncode == 1
    (error,) = (line for line in done.stderr.splitlines() if not line.startswith("note: "))
    assert error == (
        f"error: port {first + 1} of 127.0.0.1 is in use by another program; end it, or take others than "
        f"{first} to {first + len(PORTS) - 1}, as with --first-port {first + len(PORTS)}"
    )
