"""`bscd record` and the signals that end programs, in a process of its own: it is vented, and the run is closed."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from contextlib import contextmanager

from bscd.acquisition import RunFile, RunState
from tests.cli.test_record import ROOT, config

__all__ = ["config"]

#: The command, with a regulator that tells a file what it is asked for, and takes half a second to vent.
WITNESSED = """
import sys, time
from drivers.simulated import SimulatedCamera, SimulatedPressure
from bscd.cli.app import run

told = open(sys.argv[1], "w", buffering=1)
set_pressure, vent, stop = SimulatedPressure.set_pressure, SimulatedPressure.vent, SimulatedCamera.stop

def setting(self, kpa):
    set_pressure(self, kpa)
    print("set", self.set_point_kpa(), file=told)

def venting(self):
    print("venting", file=told)
    time.sleep(0.5)
    vent(self)
    print("set", self.set_point_kpa(), file=told)

def stopping(self):
    stop(self)
    print("camera stopped", file=told)

SimulatedPressure.set_pressure, SimulatedPressure.vent, SimulatedCamera.stop = setting, venting, stopping
ended = run(sys.argv[2:])
print("ended", ended, file=told)
sys.exit(ended)
"""


class Recording:
    """A recording that runs, and what its regulator has told."""

    def __init__(self, folder, config, *, stdio=None, **options):
        self.path, self._told = folder / "run.h5", folder / "told.txt"
        command = ["record", self.path, "--config", config, "--duration", "60", "--rest-frames", "2", "--top", "4"]
        self.process = subprocess.Popen(
            [sys.executable, "-c", WITNESSED, self._told, *command],
            stdin=subprocess.DEVNULL if stdio is None else stdio,
            stdout=subprocess.PIPE if stdio is None else stdio,
            stderr=subprocess.STDOUT if stdio is None else stdio,
            cwd=ROOT,
            **options,
        )

    def told(self):
        return self._told.read_text().splitlines() if self._told.exists() else []

    def wait_for(self, what):
        """Until the lines that were told are such."""
        deadline_s = time.monotonic() + 60.0
        while not what(lines := self.told()):
            assert self.process.poll() is None, lines
            assert time.monotonic() < deadline_s, lines
            time.sleep(0.01)

    def wait_for_pressure(self):
        self.wait_for(lambda lines: any(float(line.split()[1]) > 0.2 for line in lines if line.startswith("set ")))

    def check(self, reason):
        """It ended vented, with the camera stopped, and the run says why."""
        lines = self.told()
        vented = max(number for number, line in enumerate(lines) if line == "set 0.0")
        assert not [line for line in lines[vented:] if line.startswith("set ") and line != "set 0.0"]
        pressed = max(number for number, line in enumerate(lines) if line.startswith("set ") and line != "set 0.0")
        assert lines[pressed + 1 : pressed + 3] == ["venting", "set 0.0"]
        assert lines[pressed + 3] == "camera stopped"
        with RunFile(self.path) as run:
            assert run.state is RunState.INTERRUPTED
            assert reason in run.reason
            assert len(run.table()) + sum(loss.count for loss in run.losses) == run.frames_acquired > 0
            assert run.verify() is None


@contextmanager
def recording(*arguments, **options):
    made = Recording(*arguments, **options)
    try:
        yield made
    finally:
        made.process.kill()
        made.process.communicate()


def test_a_request_to_end_ends_it_vented(config, tmp_path):
    with recording(tmp_path, config) as made:
        made.wait_for_pressure()
        made.process.send_signal(signal.SIGTERM)
        assert made.process.wait(60) == 1
        made.check("stopped as asked")


def test_more_of_them_wait_until_it_is_vented(config, tmp_path):
    """And one that is ignored, as under nohup, ends nothing."""
    with recording(tmp_path, config, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)) as made:
        made.wait_for_pressure()
        made.process.send_signal(signal.SIGHUP)
        many = len(made.told()) + 5
        made.wait_for(lambda lines: len(lines) > many)
        before = made.told().count("venting")
        made.process.send_signal(signal.SIGINT)
        made.wait_for(lambda lines: lines.count("venting") > before)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
            made.process.send_signal(number)
            time.sleep(0.05)
        assert made.told()[-1] == "venting"
        assert made.process.wait(60) == 1
        made.check("stopped as asked")


def test_a_terminal_that_is_closed_ends_it_vented(config, tmp_path):
    ours, theirs = pty.openpty()
    # the terminal becomes the one of the process's session, so that the system signals its end
    with recording(
        tmp_path,
        config,
        stdio=theirs,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    ) as made:
        os.close(theirs)
        made.wait_for_pressure()
        os.close(ours)
        made.process.wait(60)
        made.check("stopped as asked")
