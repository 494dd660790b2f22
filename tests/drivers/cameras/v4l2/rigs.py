"""The V4L2 driver on a capture that is put in the device's place."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from drivers.cameras.v4l2 import V4l2Camera, V4l2Options
from drivers.registry import DriverContext
from tests.drivers.cameras.v4l2.fake_capture import FakeDevice

PATH = "/dev/v4l/by-id/fake"


def make(device: FakeDevice, **options: Any) -> V4l2Camera:
    values = {"device": PATH, "width_px": 32, "height_px": 24, "pixel_size_mm": 0.005, **options}
    return V4l2Camera(V4l2Options.model_validate(values), DriverContext("primary"), device.open)


def until(condition: Callable[[], object], within_s: float = 10.0) -> None:
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, "it did not happen in time"
        time.sleep(0.01)
