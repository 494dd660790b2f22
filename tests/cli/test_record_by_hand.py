"""`bscd record` on a rig whose lab jacks are turned by hand: at a terminal, and without one."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bscd.acquisition import RunFile
from tests.cli.small_rig import ROOT, small_twin

OPTIONS = ["--duration", "1.5", "--top", "4", "--rest-frames", "3"]
HEIGHT = "jacks: what height do both jacks show together, in mm? Do not turn them.\nmm: "
TURN = "jacks: turn the lower jack to 35 mm and the upper jack to 35 mm, 70 mm together; then tell the height"


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("by-hand") / "rig.toml"
    path.write_text(small_twin({"jacks": {"driver": "axis.manual"}}))
    return path


class AtTheTerminal:
    """The command, with a terminal for standard input; what it says is read as it comes."""

    def __init__(self, config, path):
        self._keyboard, terminal = os.openpty()
        self.process = subprocess.Popen(
            [Path(sys.executable).with_name("bscd"), "record", path, "--config", config, *OPTIONS],
            stdin=terminal,
            stderr=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=ROOT,
            env=os.environ | {"COLUMNS": "200"},
        )
        os.close(terminal)
        self.said = ""

    def says(self, words):
        assert self.process.stderr is not None
        while words not in self.said:
            came = os.read(self.process.stderr.fileno(), 4096)
            assert came, f"it ended without {words!r}: {self.said!r}"
            self.said += came.decode()

    def type(self, line):
        os.write(self._keyboard, line)

    def ends(self):
        told, said = self.process.communicate(timeout=120)
        self.said += said.decode()
        os.close(self._keyboard)
        return self.process.returncode, told.decode()


def test_the_height_is_asked_for_then_the_jacks_are_turned(config, tmp_path):
    path = tmp_path / "run.h5"
    command = AtTheTerminal(config, path)
    command.says(HEIGHT)
    command.type(b"5\n")
    command.says(TURN)
    command.says("mm [70]: ")
    command.type(b"70.1\n")
    code, told = command.ends()
    assert code == 0, command.said
    assert f"{path}: " in told
    with RunFile(path) as run:
        assert run.complete
        assert set(run.table()["jack_mm"].tolist()) == {70.1}


def test_ctrl_c_withdraws_the_question_and_vents(config, tmp_path):
    path = tmp_path / "run.h5"
    command = AtTheTerminal(config, path)
    command.says(HEIGHT)
    command.type(b"5\n")
    command.says("mm [70]: ")
    command.process.send_signal(signal.SIGINT)
    code, _ = command.ends()
    assert code == 1
    assert "error: jacks: moving to 70 mm: stopped before the operator confirmed a height" in command.said


def test_without_a_terminal_it_says_what_to_do_once_it_has_to_ask(config, tmp_path):
    path = tmp_path / "run.h5"
    command = [Path(sys.executable).with_name("bscd"), "record", path, "--config", config, *OPTIONS]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, cwd=ROOT, timeout=120, check=False
    )
    told = "error: jacks: there is no operator to ask: standard input is no terminal; run it at a terminal, or in the"
    assert (done.returncode, done.stderr) == (1, f"{told} daemon (bscd serve)\n")
    assert not path.exists()
