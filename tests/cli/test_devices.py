"""`bscd devices` looks, beside a program that works with the rig, and changes nothing."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from bscd.cli.app import run as bscd
from drivers.errors import MoveStoppedError
from tests.cli.small_rig import ROOT, small_twin
from tests.drivers.jacks import rigs as jacks
from tests.drivers.pressure import rigs as pressure
from tests.drivers.stages import rigs as stages

MANUAL_JACKS = {"driver": "axis.manual", "serial": "281-1, 281-2"}


def devices(path, *options):
    """The command in a process of its own, as it is: its axes' lines end with it."""
    command = [Path(sys.executable).with_name("bscd"), "devices", "--config", path, *options]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=120, check=False)


def wait_for(happened):
    deadline_s = time.monotonic() + 20.0
    while not happened():
        assert time.monotonic() < deadline_s, "it did not happen"
        time.sleep(0.01)


@pytest.mark.parametrize("watchdog_s", [0, 10])
def test_a_pressure_that_another_program_holds_stays(tmp_path, watchdog_s):
    with pressure.pressure_rig(watchdog_s=watchdog_s, answer_timeout_s=3.0) as rig:
        section = pressure.settings(rig.emulator.address, regulator=pressure.REGULATOR, answer_timeout_s=3.0)
        path = tmp_path / "rig.toml"
        path.write_text(small_twin({"pressure": {"driver": "pressure.labjack_t7", **section}}))
        rig.driver.connect()
        rig.driver.set_pressure(8.0)
        wait_for(lambda: rig.truth_kpa() > 7.9)
        written = rig.emulator.watchdog_writes
        done = devices(path, "--no-found")
        assert (done.returncode, done.stderr) == (0, "")
        assert "pressure     pressure.labjack_t7  answers: LabJack T7 with regulator" in done.stdout
        assert "; 8.0" in done.stdout or "; 7.9" in done.stdout
        assert rig.driver.set_point_kpa() == pytest.approx(8.0)
        assert rig.simulated.set_point_kpa() == pytest.approx(8.0)
        assert rig.truth_kpa() > 7.9
        assert rig.emulator.watchdog_writes == written


def test_axes_that_another_program_moves_move_on(tmp_path, monkeypatch):
    """The gateway of the jacks serves two programs, as many do, the stage one."""
    monkeypatch.setattr("drivers.emulators.modbus.jacks.GATEWAY_CLIENTS", 2)
    with (
        jacks.jack_rig("tcp", speed_mm_s=1.0) as rig,
        stages.serving(stages.ximc_emulator("mm", "tcp")) as emulator,
    ):
        stage = stages.ximc_axis("mm", emulator.address, speed=1.0)
        stage.connect()
        stage.home()
        rig.ready()
        section = jacks.options(rig.emulator.address, speed_mm_s=1.0).model_dump(mode="json")
        translation = stages.ximc_options("mm", emulator.address, speed=1.0)
        path = tmp_path / "rig.toml"
        path.write_text(
            small_twin(
                {"jacks": {"driver": "axis.modbus", **section}, "translation": {"driver": "axis.ximc", **translation}}
            )
        )
        ended = []

        def move(axis, position):
            try:
                axis.move_to(position)
            except MoveStoppedError as error:
                ended.append(str(error))

        moves = [threading.Thread(target=move, args=target) for target in ((rig.driver, 80.0), (stage, 90.0))]
        for moving in moves:
            moving.start()
        wait_for(lambda: rig.driver.status().moving and stage.status().moving)
        done = devices(path, "--no-found")
        assert (ended, rig.driver.status().moving, stage.status().moving) == ([], True, True)
        for axis, moving in zip((rig.driver, stage), moves, strict=True):
            axis.stop()
            moving.join(timeout=20)
        stage.close()
    assert len(ended) == 2
    assert done.returncode == 1
    assert "jacks        axis.modbus          answers: " in done.stdout
    assert "translation  axis.ximc            NO ANSWER: connecting: it hangs up before it says a word" in done.stdout


def test_jacks_that_are_turned_by_hand_answer_without_a_question(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(small_twin({"jacks": MANUAL_JACKS}))
    done = devices(path, "--no-found")
    assert (done.returncode, done.stderr) == (0, "")
    assert "jacks        axis.manual          answers: the operator lab jacks turned by hand" in done.stdout
    assert "serial 281-1, 281-2; not homed, limits 0 to 84" in done.stdout


def test_a_regulator_that_is_turned_by_hand_is_not_told_to_vent(tmp_path):
    with pressure.pressure_rig("manual", answer_timeout_s=3.0) as rig:
        section = pressure.settings(rig.emulator.address, answer_timeout_s=3.0)
        path = tmp_path / "rig.toml"
        path.write_text(small_twin({"pressure": {"driver": "pressure.manual", **section}}))
        rig.driver.connect()
        rig.simulated.set_pressure(4.0)
        wait_for(lambda: rig.truth_kpa() > 3.95)
        done = devices(path, "--no-found")
        assert (done.returncode, done.stderr) == (0, "")
        assert "vent" not in done.stdout
        assert rig.truth_kpa() > 3.95


def test_cameras_that_can_be_seen_are_listed(tmp_path, monkeypatch, capsys):
    (tmp_path / "v4l/by-id").mkdir(parents=True)
    (tmp_path / "video0").touch()
    (tmp_path / "v4l/by-id/usb-Maker_Camera_0001-video-index0").symlink_to("../../video0")
    monkeypatch.setattr("drivers.ports.DEV", tmp_path)
    assert bscd(["devices"]) == 0
    said = capsys.readouterr().out
    assert f"  camera.v4l2          {tmp_path}/v4l/by-id/usb-Maker_Camera_0001-video-index0 ({tmp_path}/video0)" in said
    assert "  serial port          none" in said


def test_a_camera_that_is_not_there_is_told_in_a_line(tmp_path):
    path = tmp_path / "rig.toml"
    camera = {"driver": "camera.v4l2", "device": "/dev/v4l/by-id/none", "pixel_size_mm": 0.005}
    path.write_text(small_twin({"primary": camera}))
    done = devices(path, "--no-found")
    assert (done.returncode, done.stderr) == (1, "")
    told = "primary      camera.v4l2          NO ANSWER: connecting: there is no /dev/v4l/by-id/none; check its cable"
    assert told in done.stdout
