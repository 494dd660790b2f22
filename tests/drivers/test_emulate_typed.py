"""Lines typed at the real `bscd emulate` put faults into it that drivers see; without input it serves on."""

from __future__ import annotations

import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from zaber_motion import Units
from zaber_motion.ascii import Connection

from drivers.cameras.aravis import AravisCamera, AravisOptions
from drivers.emulators.rig import ZABER_MICROSTEPS_PER_UNIT
from drivers.errors import DeviceError, DeviceTimeoutError, NotConnectedError, NotHomedError
from drivers.interfaces import Axis
from drivers.registry import DriverContext, installed_drivers
from tests.drivers.emulate_process import BSCD, Emulation, emulating, free_ports
from tests.drivers.fast_twin import fast_twin
from tests.drivers.gige_rig import require_aravis
from tests.drivers.stages.rigs import zaber_axis

pytestmark = pytest.mark.own_network

PATIENCE_S = 30.0


@pytest.fixture
def twin(tmp_path) -> Path:
    file = tmp_path / "twin.toml"
    file.write_text(fast_twin(), encoding="utf-8")
    return file


def axis_of(config: Path, name: str, **changes: object) -> Axis:
    """The driver that the written configuration names."""
    section = {**tomllib.loads(config.read_text())["devices"][name], **changes}
    return installed_drivers()[section.pop("driver")].build(section, DriverContext(name))


def until_it_answers(call: Callable[[], object]) -> None:
    """Make a call until it does not fail any more."""
    began_s = time.monotonic()
    while True:
        try:
            call()
        except DeviceError:
            assert time.monotonic() - began_s < PATIENCE_S
        else:
            return


def test_the_makers_client_moves_both_stages_by_the_serial_port(twin, tmp_path):
    with emulating(tmp_path / "emulated.toml", "--config", str(twin)) as emulation:
        with Connection.open_serial_port(emulation.address(of="Zaber devices", serial=True)) as connection:
            found = connection.detect_devices(identify_devices=False)
            assert [device.device_address for device in found] == [1, 2]
            for device in found:
                axis = device.get_axis(1)
                axis.home()
                axis.move_absolute(12345, Units.NATIVE)
                assert axis.get_position(Units.NATIVE) == 12345
        # the same stages by Zaber's TCP line, with our driver
        axis = zaber_axis("mm", emulation.address(of="Zaber devices"), address=2, speed=50.0, acceleration=150.0)
        axis.connect()
        assert axis.status().homed
        assert axis.status().position == pytest.approx(12345 / ZABER_MICROSTEPS_PER_UNIT["mm"], abs=1e-9)
        axis.close()


def test_typed_faults_strike_the_stage_whatever_it_speaks(twin, tmp_path):
    config = tmp_path / "emulated.toml"
    wrong = (
        "error: there is no device 'rotaton'; name one of primary, auxiliary, rotation, translation, jacks, pressure"
    )
    with emulating(config, "--config", str(twin), stdin=subprocess.PIPE, errors=[wrong]) as emulation:
        if not any("GigE" in line for line in emulation.lines):
            pytest.skip("no cameras, so other names")
        ximc = axis_of(config, "rotation", answer_timeout_s=0.2)
        zaber = [
            zaber_axis(unit, emulation.address(of="Zaber devices"), address=place, answer_timeout_s=0.2, **fast)
            for place, (unit, fast) in enumerate((("deg", {"speed": 90.0}), ("mm", {"speed": 50.0})), start=1)
        ]
        for axis in (ximc, *zaber):
            until_it_answers(axis.connect)
        assert emulation.type("fault rotation silence 6") == "rotation: silence for 6 s"
        for axis in (ximc, zaber[0]):
            with pytest.raises(DeviceTimeoutError, match="no answer within"):
                axis.status()
        until_it_answers(zaber[1].status)
        with pytest.raises(DeviceTimeoutError, match="no answer within"):
            zaber[0].status()
        for axis in (ximc, zaber[0]):
            until_it_answers(axis.status)
        assert emulation.process.stdin is not None
        emulation.process.stdin.write("fault rotaton silence 3\n")
        assert emulation.type("help").startswith("fault DEVICE FAULT SECONDS")
        for axis in (ximc, *zaber):
            axis.close()


def test_a_typed_power_cycle_makes_a_stage_forget_where_it_is(twin, tmp_path):
    config = tmp_path / "emulated.toml"
    with emulating(config, "--config", str(twin), stdin=subprocess.PIPE) as emulation:
        axis = axis_of(config, "translation", answer_timeout_s=5.0)
        axis.connect()
        axis.home()
        axis.move_to(3.0)
        assert emulation.type("fault translation power-cycle") == "translation: switched off and on"
        with pytest.raises(NotConnectedError):
            axis.move_to(4.0)
        axis.connect()
        with pytest.raises(NotHomedError):
            axis.move_to(4.0)
        axis.close()


def test_typed_lost_packets_cost_frames_until_their_end(tmp_path):
    require_aravis()
    config = tmp_path / "emulated.toml"
    with emulating(config, stdin=subprocess.PIPE) as emulation:
        section = tomllib.loads(config.read_text())["devices"]["primary"]
        del section["driver"]
        camera = AravisCamera(
            AravisOptions.model_validate({**section, "stall_timeout_s": 60.0}), DriverContext("primary")
        )
        camera.connect()
        camera.start()
        camera.read(PATIENCE_S)
        assert camera.counters().missing_packets == 0
        assert emulation.type("fault primary lost-packets 2") == "primary: lost-packets for 2 s"
        deadline_s = time.monotonic() + PATIENCE_S
        while camera.status().lost_frames == 0:  # told when the frame after them is read
            assert time.monotonic() < deadline_s
            with suppress(DeviceError):
                camera.read(1.0)
        assert camera.counters().missing_packets > 0
        in_a_row, last = 0, -1
        while in_a_row < 5:
            assert time.monotonic() < deadline_s
            with suppress(DeviceError):
                frame_id = camera.read(1.0).frame_id
                in_a_row, last = in_a_row + 1 if frame_id == last + 1 else 0, frame_id
        camera.close()


@pytest.mark.parametrize("end", ["empty", "closed", "ended"])
def test_the_end_of_its_input_does_not_end_it(twin, tmp_path, end):
    """As a service and under nohup it has none; a pipe into it ends with the script that writes."""
    config = tmp_path / "emulated.toml"
    before = ["sh", "-c", 'exec "$@" <&-', "sh"] if end == "closed" else []
    stdin = subprocess.PIPE if end == "ended" else subprocess.DEVNULL
    with emulating(config, "--config", str(twin), before=before, stdin=stdin) as emulation:
        if end == "ended":
            is_told_without_a_newline(emulation)
        time.sleep(1.0)
        axis = axis_of(config, "translation", answer_timeout_s=5.0)
        axis.connect()
        axis.close()
        assert emulation.process.poll() is None


def is_told_without_a_newline(emulation: Emulation) -> None:
    assert emulation.process.stdin is not None
    assert emulation.process.stdout is not None
    emulation.process.stdin.write("fault jacks late 1")
    emulation.process.stdin.close()
    emulation.process.stdin = None
    assert emulation.process.stdout.readline() == "jacks: late for 1 s\n"


def test_in_the_background_of_a_shell_it_is_not_stopped_and_takes_nothing_typed_at_the_shell():
    shell = [sys.executable, "-c", "import pty; pty.spawn(['bash', '--norc', '-i'])"]
    with subprocess.Popen(
        shell, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as child:
        assert child.stdin is not None
        assert child.stdout is not None

        def says(line: str, *, until: str) -> str:
            child.stdin.write(line + "\n")
            child.stdin.flush()
            said = ""
            while until not in said:
                more = child.stdout.readline()
                assert more, said
                said += more
            return said

        try:
            says(f"{BSCD} emulate --first-port {free_ports()} &", until="serving;")
            for _ in range(5):
                assert "no order" not in says("echo typed at the $((1 + 1))nd", until="typed at the 2nd\n")
                time.sleep(0.2)
            assert "Running" in says("jobs; echo $((2 + 2)) jobs", until="4 jobs\n")
            says("kill %1; wait; echo $((3 + 3)) ended", until="6 ended\n")
        finally:
            child.kill()  # its terminal goes, and with it what it has started
