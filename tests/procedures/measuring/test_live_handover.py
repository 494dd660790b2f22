"""Handing frames over to a live measurement: nothing that it does, or does not, keeps the recorder waiting."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from bscd.acquisition import FrameRecord, RunFile, RunState
from bscd.acquisition.stream import FrameRing
from bscd.errors import BscdError
from bscd.procedures.live import LiveFollower
from bscd.results import ResultsFile
from drivers.interfaces import FrameStatus
from tests.procedures.measuring.test_live import WAIT_S, measuring, pushed, until

SMALL = np.zeros((8, 8), np.uint8)


def test_one_that_hangs_holds_nobody_up(wide, inflation_run, tmp_path):
    with measuring(wide, inflation_run, tmp_path / "live.h5") as live:
        assert live.wait_ready(WAIT_S)
        os.kill(live.process_id, signal.SIGSTOP)

        def push():
            for number in range(300):  # more than the pipe takes
                live.push(number, SMALL, number / 11, 0.05)

        pushing = threading.Thread(target=push, daemon=True)
        pushing.start()
        pushing.join(30.0)
        assert not pushing.is_alive()
        assert (live.pushed, live.missed) == (256, 44)
        begun_s = time.monotonic()
        with pytest.raises(BscdError, match="no frame was measured for 1 s; measure the run with bscd measure"):
            live.finish(inflation_run, 1.0)
        assert time.monotonic() - begun_s < 5.0
        assert not live.push(300, SMALL, 30.0, 0.05)
        begun_s = time.monotonic()
    assert time.monotonic() - begun_s < 30.0
    assert not [name for name in os.listdir("/dev/shm") if name.startswith(f"bscd-{os.getpid()}-")]


def test_catching_up_takes_no_longer_than_it_may(wide, inflation_run, tmp_path):
    with measuring(wide, inflation_run, tmp_path / "live.h5") as live:
        pushed(live, inflation_run, skip=(11,))
        until(lambda: len(live.latencies_s) == 11, "what was pushed is measured")
        os.kill(live.process_id, signal.SIGSTOP)
        begun_s = time.monotonic()
        with pytest.raises(BscdError, match="more than 1 s to catch up"):
            live.finish(inflation_run, WAIT_S, most_s=1.0)
        assert time.monotonic() - begun_s < 5.0
        os.kill(live.process_id, signal.SIGCONT)
    with ResultsFile(tmp_path / "live.h5") as results, RunFile(inflation_run) as run:
        assert (results.state, results.reason) == (RunState.INTERRUPTED, "more than 1 s to catch up")
        assert results.header.run.uuid == run.uuid


@pytest.mark.parametrize("case", ["share", "filled"])
def test_little_shared_memory_costs_time_not_results(wide, inflation_run, tmp_path, case):
    mounted = "mount -t tmpfs -o size=48m tmpfs /dev/shm"
    if subprocess.run(["unshare", "-rm", "sh", "-c", mounted], capture_output=True).returncode:
        pytest.skip("the system lets nobody mount a small /dev/shm")
    wide.save(tmp_path / "cal.h5")
    program = [sys.executable, "-m", "tests.procedures.measuring.little_memory", case]
    paths = [str(path) for path in (tmp_path / "cal.h5", inflation_run, tmp_path / "live.h5")]
    told = subprocess.run(
        ["unshare", "-rm", "sh", "-c", f'{mounted} && exec "$@"', "sh", *program, *paths],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
    )
    assert (told.returncode, told.stderr) == (0, "")
    assert told.stdout == "as wanted\n"


class Kept:
    """In place of a live measurement: what it would get."""

    def __init__(self):
        self.exposed_ns = []
        self.numbers = []
        self.skipped = []

    def push(self, number, frame, time_s, pressure_kpa, *, exposed_ns):
        self.numbers.append(number)
        self.exposed_ns.append(exposed_ns)

    def skip(self, number):
        self.skipped.append(number)


def test_a_frame_counts_from_the_middle_of_its_exposure():
    exposure_s, readout_s, begun_ns = 0.02, 0.013, 5_000_000_000
    middles_ns = [begun_ns + round(number / 11 * 1e9) for number in range(6)]
    late_ns = [4_000_000, 0, 2_000_000, 30_000_000, 0, 1_000_000]  # on the way through the host
    kept = Kept()
    follower = LiveFollower(kept, readout_s)  # pyright: ignore[reportArgumentType]
    with FrameRing(SMALL.shape, np.uint8) as ring:
        follower.begin(ring)
        for number, (middle_ns, delay_ns) in enumerate(zip(middles_ns, late_ns, strict=True)):
            arrived_ns = middle_ns + round((exposure_s / 2 + readout_s) * 1e9) + delay_ns
            ring.publish(
                number,
                FrameRecord(
                    "primary",
                    "inflation",
                    SMALL,
                    number,
                    camera_time_ns=77 + middle_ns,
                    host_time_ns=arrived_ns,
                    exposure_s=exposure_s,
                    time_s=(middle_ns - begun_ns) * 1e-9,
                ),
            )
        ring.end()
        until(lambda: len(kept.exposed_ns) == 6, "all frames are handed over")
        follower.end()
    assert kept.exposed_ns[0] - middles_ns[0] == pytest.approx(4_000_000, abs=10)  # nothing to compare it with yet
    np.testing.assert_allclose(kept.exposed_ns[1:], middles_ns[1:], rtol=0, atol=10)


def test_frames_are_numbered_as_recorded_damaged_ones_among_them():
    kept = Kept()
    follower = LiveFollower(kept)  # pyright: ignore[reportArgumentType]
    with FrameRing(SMALL.shape, np.uint8) as ring:
        follower.begin(ring)
        for number, status in enumerate(["ok", "incomplete", "ok", "incomplete", "ok"]):
            known = {"status": FrameStatus(status), "exposure_s": 0.02, "time_s": number / 11}
            ring.publish(number, FrameRecord("primary", "inflation", SMALL, number, **known))
        ring.end()
        follower.end()
    assert (kept.numbers, kept.skipped) == ([0, 2, 4], [1, 3])
