"""The twin's cameras behind GigE Vision, for tests of the emulator and of the driver."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from drivers.cameras.aravis import AravisCamera, AravisOptions
from drivers.cameras.aravis.library import aravis_for
from drivers.emulators.gige import GigeEmulator
from drivers.emulators.wire import WireFault
from drivers.errors import DeviceTimeoutError, NotConnectedError
from drivers.interfaces import Frame
from drivers.registry import DriverContext
from drivers.simulated import SimulatedCamera, SimulatedCameraOptions
from drivers.twin.options import AuxiliaryGeometry, CameraGeometry, SensorOptions, TwinOptions
from drivers.twin.world import World
from tests.drivers.own_network import one_at_a_time

FEW_PIXELS: dict[str, Any] = {"pixel_size_mm": 0.0536, "width_px": 160, "height_px": 128}


def require_aravis() -> None:
    """Skip where Aravis or PyGObject is missing."""
    try:
        aravis_for("tests")
    except NotConnectedError as error:
        pytest.skip(str(error))


def small_world(bits: int = 8) -> World:
    geometries = {"primary": CameraGeometry(**FEW_PIXELS), "auxiliary": AuxiliaryGeometry(**FEW_PIXELS)}
    return World(TwinOptions(**geometries, sensor=SensorOptions(bits=bits)))


def simulated(world: World, camera: str = "primary", **options: Any) -> SimulatedCamera:
    limits = {"frame_rate_limits_hz": (0.1, 1000.0), **options}
    return SimulatedCamera(
        SimulatedCameraOptions.model_validate({"camera": camera, **limits}), DriverContext(camera, world=world)
    )


@contextmanager
def serving(world: World, **options: Any) -> Iterator[GigeEmulator]:
    """The primary camera of a world at 127.0.0.1."""
    require_aravis()
    with one_at_a_time():
        emulator = GigeEmulator(simulated(world, **options))
        emulator.start()
        try:
            yield emulator
        finally:
            emulator.stop()


@contextmanager
def open_camera(address: str = "127.0.0.1", name: str = "primary", **options: Any) -> Iterator[AravisCamera]:
    """A connected driver."""
    camera = AravisCamera(AravisOptions.model_validate({"address": address, **options}), DriverContext(name))
    camera.connect()
    try:
        yield camera
    finally:
        camera.close()


def read_until(camera: AravisCamera, wanted: Callable[[Frame], bool], within_s: float = 20.0) -> Frame:
    """The first frame for which ``wanted`` holds, over any error on the way."""
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        try:
            frame = camera.read(1.0)
        except (DeviceTimeoutError, NotConnectedError):
            continue
        if wanted(frame):
            return frame
    raise AssertionError(f"no such frame within {within_s} s; {camera.status()}")


def is_true(world: World, frame: Frame) -> bool:
    """Whether a frame is what the sensor sees at 2 ms, up to its noise."""
    expected = 0.1 * 255 * world.irradiance("primary")
    return float(np.max(np.abs(frame.data - expected))) < 12.0


def drained(emulator: GigeEmulator, camera: AravisCamera) -> tuple[list[Frame], int]:
    """The frames that are still on their way when the camera makes no more, and how many it made in all."""
    emulator.faults.inject(WireFault.SILENCE)
    frames = []
    try:
        while True:
            frames.append(camera.read(0.5))
    except DeviceTimeoutError:
        return frames, emulator.sent_frames
    finally:
        emulator.faults.clear()
