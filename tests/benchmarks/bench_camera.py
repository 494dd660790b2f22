"""Rates and losses of the GigE Vision driver on the emulated cameras, 1280x1024 over loopback.

Run it as ``scripts/bench camera``; it takes a network namespace of its own where the system allows one.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np

from drivers.cameras.aravis import AravisCamera, AravisOptions
from drivers.emulators.gige import GigeEmulator, serve_cameras
from drivers.emulators.gige.loopback import bring_up
from drivers.emulators.wire import WireFault
from drivers.errors import DeviceTimeoutError
from drivers.registry import DriverContext
from drivers.simulated import SimulatedCamera, SimulatedCameraOptions
from drivers.twin.options import TwinOptions
from drivers.twin.world import World
from tests.drivers.own_network import can_unshare, one_at_a_time

INSIDE = "BSCD_BENCH_OWN_NETWORK"
NAMES = ("primary", "auxiliary")


def cameras(addresses: Sequence[str], **options: float) -> list[AravisCamera]:
    """Connected drivers."""
    made = []
    for address, name in zip(addresses, NAMES, strict=False):
        values = {"address": address, "buffer_frames": 64, "stream_buffers": 64, **options}
        camera = AravisCamera(AravisOptions.model_validate(values), DriverContext(name))
        camera.connect()
        made.append(camera)
    return made


def finish(made: Sequence[AravisCamera], emulators: Sequence[GigeEmulator]) -> list[int]:
    """Read what is on its way when the cameras make no more; returns how many frames each sent since it was made."""
    for emulator in emulators:
        emulator.faults.inject(WireFault.SILENCE)
    for camera in made:
        try:
            while True:
                camera.read(0.3)
        except DeviceTimeoutError:
            pass
    sent = [emulator.sent_frames for emulator in emulators]
    for emulator in emulators:
        emulator.faults.clear()
    return sent


def stream(title: str, emulators: Sequence[GigeEmulator], frames: int, **options: float) -> None:
    """Read so many frames of each camera and print what became of them and of the others that it sent."""
    made = cameras([emulator.address for emulator in emulators], **options)
    before = [emulator.sent_frames for emulator in emulators]
    busy_s = time.process_time()
    for camera in made:
        camera.start()
    for camera in made:
        camera.read()
    began_s = time.perf_counter()
    last = []
    for _ in range(frames):
        last = [camera.read() for camera in made]
    wall_s = time.perf_counter() - began_s
    busy_s = time.process_time() - busy_s
    after = finish(made, emulators)
    for camera, sent_before, sent_after, frame in zip(made, before, after, last, strict=True):
        sent = sent_after - sent_before
        counters, status = camera.counters(), camera.status()
        lost = status.lost_frames
        assert sent == status.delivered_frames + lost, "a loss that was not counted"
        camera.stop()
        megabytes = frames * frame.data.nbytes / 1e6
        print(
            f"{title:34s} {camera.name:10s} {frames / wall_s:7.1f} frames/s {megabytes / wall_s:7.1f} MB/s "
            f"{lost:3d} of {sent} lost; failed {counters.failed}, underrun {counters.underrun}, "
            f"no room {counters.overrun}, packets missing {counters.missing_packets}; "
            f"processor {100 * busy_s / wall_s:.0f} %"
        )
        camera.close()


def snaps(address: str, count: int) -> None:
    """How long a single frame takes beyond its exposure."""
    (camera,) = cameras([address], exposure_s=0.001)
    took_s = []
    for _ in range(count):
        began_s = time.perf_counter()
        camera.snap()
        took_s.append(time.perf_counter() - began_s - 0.001)
    camera.close()
    print(f"{'a snap beyond its exposure':34s} primary    median {1e3 * np.median(took_s):.0f} ms of {count}")


def main() -> None:
    """Serve the twin's cameras and print a line for each case and camera."""
    if INSIDE not in os.environ and can_unshare():
        command = ["unshare", "-rn", sys.executable, "-m", "tests.benchmarks.bench_camera"]
        sys.exit(subprocess.run(command, env={**os.environ, INSIDE: "1"}, timeout=600).returncode)
    if INSIDE in os.environ:
        bring_up()
    world = World(TwinOptions())
    for name in NAMES:
        world.irradiance(name)
    simulated = [
        SimulatedCamera(
            SimulatedCameraOptions(camera=name, frame_rate_limits_hz=(0.1, 2000.0)), DriverContext(name, world=world)
        )
        for name in NAMES
    ]
    with one_at_a_time():
        served = serve_cameras(simulated)
        emulators = served.emulators
        for text in served.missing:
            print(text)
        stream("11 fps, one camera", emulators[:1], 110, frame_rate_hz=11.0)
        stream("11 fps, both cameras", emulators, 110, frame_rate_hz=11.0)
        stream("60 fps, one camera", emulators[:1], 600, frame_rate_hz=60.0, exposure_s=0.001)
        stream("as fast as it goes, one camera", emulators[:1], 1500, frame_rate_hz=1000.0, exposure_s=1e-4)
        stream("as fast as it goes, both cameras", emulators, 1500, frame_rate_hz=1000.0, exposure_s=1e-4)
        snaps(emulators[0].address, 30)
        served.stop()
    world.close()


if __name__ == "__main__":
    main()
