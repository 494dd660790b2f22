"""Rates and losses from an in-process source through the ring to the disk, 1280x1024 8 bit.

Run it as ``scripts/bench stream``; it writes up to 6 GB beside the checkout, one run at a time.
``python -m tests.benchmarks.bench_stream --long`` first records ten minutes over GigE Vision through the daemon, twice:
without and with live results; that takes 22 minutes more, and 9 GB.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bscd.acquisition import Compression, RunFile, RunWriter
from bscd.acquisition.stream import FrameAccount, FrameRing, LiveView, Recorder
from tests.acquisition.stream.sources import camera, image, record
from tests.benchmarks import live
from tests.drivers.own_network import one_at_a_time
from tests.drivers.test_served_soak import HOLD_S, RAMP_S, RATE_HZ, soaked

SHAPE = (1024, 1280)
SLOTS = 64
LASTING_S = 12.0


@dataclass(frozen=True)
class Measured:
    """What became of one run."""

    frames: int
    lost: int
    peak_fill: int
    wall_s: float
    busy_s: float
    size_bytes: int


def stream(path: Path, rate_hz: float, lasting_s: float, compression: Compression, *, sync: bool) -> Measured:
    """Publish so long at a rate, paced by the clock whatever the ring does; the file is checked and removed."""
    images = [image(number, SHAPE) for number in range(16)]
    writer = RunWriter(
        path,
        title="stream",
        cameras=camera(SHAPE),
        flush_every=max(1, round(rate_hz)),
        compression=compression,
        sync=sync,
    )
    account, number = FrameAccount(), 0
    with writer, FrameRing(SHAPE, np.uint8, SLOTS) as ring:
        recorder, view = Recorder(writer, ring, account), LiveView(ring)
        recorder.start()
        template = record(0, SHAPE)
        begun_s, busy_s = time.perf_counter(), time.process_time()
        while (due_s := begun_s + number / rate_hz) < begun_s + lasting_s:
            time.sleep(max(0.0, due_s - time.perf_counter()))
            account.exposed(number, "")
            frame = type(template)("primary", "inflation", images[number % 16], frame_id=number)
            if not ring.publish(number, frame):
                account.lose(number, "the ring was full")
            if number % 10 == 0:
                view.latest()
            number += 1
        recorder.finish(60.0)
        assert recorder.failure is None
        assert account.difference(writer.frames_written) == ""
        peak, frames = ring.peak_fill, writer.frames_written
        wall_s, busy_s = time.perf_counter() - begun_s, time.process_time() - busy_s
        writer.account(account.acquired, account.losses)
    with RunFile(path) as run:
        ids = set(run.table()["frame_id"].tolist())
        lost = {n for loss in run.losses for n in range(loss.first, loss.first + loss.count)}
        assert ids | lost == set(range(number))
        assert not ids & lost
    size = path.stat().st_size
    path.unlink()
    return Measured(frames, account.lost, peak, wall_s, busy_s, size)


def served(place: Path, hold_s: float) -> None:
    """Print a line for a long recording over GigE Vision, and one for the same with live results."""
    print(f"over GigE Vision through the daemon at {RATE_HZ:g} fps, {(RAMP_S + hold_s) / 60:.1f} min each", flush=True)
    for measured in (False, True):
        with tempfile.TemporaryDirectory(dir=place, prefix=".bench-served-") as folder, one_at_a_time():
            done = soaked(Path(folder), live=measured, hold_s=hold_s)
            with RunFile(done.run) as run:
                jumps = int(np.count_nonzero(np.diff(run.table()["frame_id"]) != 1))
                damaged = run.verify()
        told = done.figures
        line = (
            f"{'measured live' if measured else 'recorded':13s}: {told['frames']} of {done.planned} frames, "
            f"{told['lost_frames']} lost, {told['incomplete_frames']} incomplete, {jumps} ids that do not follow, "
            f"checksums {damaged or 'all right'}, ring at most {told['most_frames_waiting_for_the_disk']}; "
            f"memory of all processes {done.settled_mb:.0f} MB after a minute, at most {done.grown_mb:+.1f} MB later"
        )
        if measured:
            line += (
                f"; live {told.get('live_frames', 0)}, after the run {told.get('caught_up_frames', 0)}, "
                f"exposure to map {told.get('latency_median_s', np.nan) * 1e3:.0f} ms, "
                f"p99 {told.get('latency_p99_s', np.nan) * 1e3:.0f} ms"
            )
        print(line, flush=True)


def main() -> None:
    """Print a line for each rate, compression and policy, then those of the correlation beside it."""
    said = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    said.add_argument("place", nargs="?", type=Path, default=Path(), help="folder on the disk that is measured")
    said.add_argument("--long", action="store_true", help="also ten minutes over GigE Vision, without and with DIC")
    said.add_argument("--hold-s", type=float, default=HOLD_S, help="how long that holds the pressure, s")
    asked = said.parse_args()
    place = asked.place.resolve()
    if asked.long:
        served(place, asked.hold_s)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; ring of {SLOTS}, {LASTING_S:g} s each")
    cases: list[tuple[float, Compression, bool]] = [
        (11.0, "none", True),
        (110.0, "none", True),
        (110.0, "none", False),
        (220.0, "none", True),
        (330.0, "none", True),
        (440.0, "none", True),
        (330.0, "none", False),
        (440.0, "none", False),
        (110.0, "bitshuffle-lz4", True),
        (165.0, "bitshuffle-lz4", True),
        (220.0, "bitshuffle-lz4", True),
    ]
    with tempfile.TemporaryDirectory(dir=place, prefix=".bench-stream-") as folder:
        for rate_hz, compression, sync in cases:
            done = stream(Path(folder) / "run.h5", rate_hz, LASTING_S, compression, sync=sync)
            print(
                f"{rate_hz:5.0f} fps {rate_hz * np.prod(SHAPE) / 1e6:6.0f} MB/s  {compression:15s}"
                f"{'fsync each s' if sync else 'no fsync':14s} {done.frames:5d} frames, {done.lost:4d} lost, "
                f"ring at most {done.peak_fill:2d}, processor {100 * done.busy_s / done.wall_s:3.0f} %, "
                f"{done.size_bytes / max(done.frames, 1) / np.prod(SHAPE):.2f} of the raw size",
                flush=True,
            )
    live.main()


if __name__ == "__main__":
    main()
