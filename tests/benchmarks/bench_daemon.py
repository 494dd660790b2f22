"""The daemon while it records at 11 fps with live DIC: how fast it answers, what viewers cost, how fast it stops.

``scripts/bench daemon``: an inflation of half a minute from a replay camera (rendering would cost what no rig does)
with live results, meanwhile ``GET status`` every 20 ms, alone and beside ten MJPEG viewers of which three never read;
at the end the e-stop while other processes saturate the cores.
"""

from __future__ import annotations

import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import httpx

from bscd.calibration import Calibration
from bscd.client import Client
from tests.api.serving import configuration, idle, serving
from tests.benchmarks.live import membrane
from tests.daemon.small import until
from tests.procedures.measuring.twin_runs import wide_calibration

API = "/api/v1"
READERS, STALLED = 7, 3


def memory_mb(process_id: int) -> float:
    """Resident memory."""
    for line in Path(f"/proc/{process_id}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    return float("nan")


def main() -> None:
    """Print a line for each figure."""
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory(prefix=".bench-daemon-", dir=".") as name:
        folder = Path(name)
        source = membrane(folder / "source.h5")
        options = f'source = "{source.absolute()}"\npace = "rate"\nframe_rate_hz = 11.0\nrepeat = true'
        replay = f'driver = "camera.replay"\n{options}'
        changes = {'driver = "camera.simulated"\ncamera = "primary"': replay}
        config = configuration(folder, changes=changes, poll_s=0.5)
        calibrations = folder / "data/calibrations"
        calibrations.mkdir(parents=True)
        calibration: Calibration = wide_calibration()
        calibration.save(calibrations / "wide.h5")
        begun = time.perf_counter()
        with serving(config) as served, Client(served.url) as client:
            until(lambda: httpx.get(f"{served.url}/health/ready").status_code == 200, "a rig that is ready")
            print(f"ready after {time.perf_counter() - begun:.1f} s, its process' start included")
            idle(client)
            client.wait(client.submit({"recipe": "home"}).id)
            inflation = {"ramp_s": 25.0, "hold_s": 3.0, "top_kpa": 8.0, "rest_settle_s": 2.0}
            job = client.submit({"recipe": "inflation", "calibration": "wide", "inflation": inflation})
            until(lambda: (now := client.job(job.id)).progress and now.progress.done > 30, "frames")
            before = memory_mb(served.process.pid)
            alone = asked(served.url, 8.0)
            ending = threading.Event()
            viewers = [threading.Thread(target=read, args=(served.url, ending)) for _ in range(READERS)]
            stalled = [stall(served.url) for _ in range(STALLED)]
            for viewer in viewers:
                viewer.start()
            beside = asked(served.url, 8.0)
            after = memory_mb(served.process.pid)
            ending.set()
            told_latencies("GET status while recording with live DIC", alone)
            told_latencies(f"the same beside {READERS} viewers and {STALLED} stalled ones", beside)
            print(f"memory {before:.0f} to {after:.0f} MB")
            until(lambda: client.job(job.id).status.ended, "the inflation's end")
            over = client.job(job.id)
            figures = {
                name: over.figures.get(name) for name in ("frames", "lost_frames", "live_frames", "caught_up_frames")
            }
            print(f"the inflation: {over.status.value} {over.reason}, {figures}")
            client.wait(client.submit({"recipe": "home"}).id)
            estops_while_measuring(client)
            estops(client)
            for viewer in viewers:
                viewer.join(10.0)
            for one in stalled:
                one.close()


def estops_while_measuring(client: Client) -> None:
    """The last stop command's time, while a recording goes on with more live points than the cores can follow."""
    took_ms = []
    for _ in range(5):
        inflation = {"ramp_s": 60.0, "hold_s": 3.0, "top_kpa": 8.0, "rest_settle_s": 1.0}
        recipe = {"recipe": "inflation", "calibration": "wide", "step_px": 5, "inflation": inflation}
        job = client.submit(recipe)
        until(lambda job=job: (now := client.job(job.id)).progress and now.progress.done > 90, "frames")
        told = client.estop("benchmark")
        took_ms.append(told.took_ms or 0.0)
        until(lambda job=job: client.job(job.id).status.ended, "its end")
        client.reset_estop()
        until(lambda: client.status().state.value == "idle", "a rig at rest")
    print(
        f"e-stop while recording with live DIC at step 5: last stop command after "
        f"{statistics.median(took_ms):.1f} ms, at most {max(took_ms):.1f}"
    )


def estops(client: Client) -> None:
    """The last stop command's time, while both cores are saturated by other processes."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * (os.cpu_count() or 2))]
    try:
        took_ms, answers_ms = [], []
        for _ in range(20):
            at = time.perf_counter()
            told = client.estop("benchmark")
            answers_ms.append((time.perf_counter() - at) * 1e3)
            took_ms.append(told.took_ms or 0.0)
            client.reset_estop()
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    print(
        f"e-stop with {len(burners)} processes on {os.cpu_count()} cores: last stop command after "
        f"{statistics.median(took_ms):.1f} ms, at most {max(took_ms):.1f}; answered after "
        f"{statistics.median(answers_ms):.1f} ms, at most {max(answers_ms):.1f}"
    )


def asked(url: str, lasting_s: float) -> list[float]:
    """How long ``GET status`` took, s, asked again and again for so long."""
    latencies_s = []
    ends = time.perf_counter() + lasting_s
    with httpx.Client(base_url=url) as http:
        while (at := time.perf_counter()) < ends:
            http.get(f"{API}/status")
            latencies_s.append(time.perf_counter() - at)
            time.sleep(0.02)
    return sorted(latencies_s)


def told_latencies(what: str, latencies_s: list[float]) -> None:
    """Median and 99th percentile in a line."""
    p99 = latencies_s[int(0.99 * len(latencies_s))]
    print(f"{what}: median {statistics.median(latencies_s) * 1e3:.1f} ms, p99 {p99 * 1e3:.1f} ms of {len(latencies_s)}")


def read(url: str, ending: threading.Event) -> None:
    """A viewer that reads, and takes no processor time for it."""
    viewer = stall(url)
    viewer.settimeout(1.0)
    with viewer:
        while not ending.is_set():
            with suppress(TimeoutError):
                viewer.recv(1 << 18)


def stall(url: str) -> socket.socket:
    """A viewer that never does."""
    host, port = url.removeprefix("http://").split(":")
    viewer = socket.create_connection((host, int(port)))
    viewer.sendall(f"GET {API}/camera/primary/stream.mjpg HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
    return viewer


if __name__ == "__main__":
    main()
