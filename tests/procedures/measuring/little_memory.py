"""A live measurement on a small /dev/shm, as a program of its own: ``python -m ... CASE CALIBRATION RUN OUT``."""

import os
import shutil
import signal
import sys
from itertools import cycle, islice
from pathlib import Path

from bscd.acquisition import RunFile
from bscd.calibration import Calibration
from bscd.procedures.live import LiveFailure, LiveMeasurement
from bscd.results import ResultsFile
from tests.procedures.measuring.test_live import WAIT_S, measuring, until

ROOM = Path("/dev/shm")


def share(live: LiveMeasurement, run: Path, events: list) -> None:
    """However many frames wait, the live process has room for its own images."""
    frames = frames_of(run)
    os.kill(live.process_id, signal.SIGSTOP)
    for number, frame in enumerate(islice(cycle(frames), 60)):
        live.push(number, frame.data, frame.time_s, frame.pressure_kpa)
    assert live.missed
    assert live.pushed > 12
    assert shutil.disk_usage(ROOM).free >= 16 * frames[0].data.nbytes
    os.kill(live.process_id, signal.SIGCONT)
    until(lambda: len(live.latencies_s) == live.pushed or live.failure, "what was pushed is measured")


def filled(live: LiveMeasurement, run: Path, events: list) -> None:
    """Others fill the memory for a while: what could not be lent is left out, and measured from the run."""
    frames = frames_of(run)
    for number, frame in enumerate(frames[:6]):
        live.push(number, frame.data, frame.time_s, frame.pressure_kpa)
    until(lambda: len(live.latencies_s) == 6, "those before are measured")
    os.kill(live.process_id, signal.SIGSTOP)
    for number, frame in enumerate(frames[6:9], start=6):
        assert live.push(number, frame.data, frame.time_s, frame.pressure_kpa)
    filler = ROOM / "filler"
    filler.write_bytes(bytes(shutil.disk_usage(ROOM).free - 500_000))
    os.kill(live.process_id, signal.SIGCONT)
    until(lambda: not list(ROOM.glob(f"bscd-{os.getpid()}-*")) or live.failure, "they are taken")
    filler.unlink()


def frames_of(path: Path) -> list:
    with RunFile(path) as run:
        return list(run.frames("primary", "inflation"))


def main(case: str, calibration: Path, run: Path, out: Path) -> None:
    events: list = []
    with measuring(Calibration.load(calibration), run, out, events=events) as live:
        assert live.wait_ready(WAIT_S)
        {"share": share, "filled": filled}[case](live, run, events)
        assert not live.failure, live.failure
        if case == "filled":
            done = live.finish(run, WAIT_S)
            assert done.frames == 12
            assert done.caught_up >= 5
        else:
            assert live.finish(None, WAIT_S).frames == live.pushed
    assert not [event for event in events if isinstance(event, LiveFailure)]
    with ResultsFile(out) as results:
        assert results.complete
    print("as wanted")


if __name__ == "__main__":
    main(sys.argv[1], *(Path(one) for one in sys.argv[2:]))
