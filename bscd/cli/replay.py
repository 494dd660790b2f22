"""What the registry knows of the replay camera."""

from __future__ import annotations

from bscd.acquisition.replay import ReplayCamera, ReplayOptions
from drivers.registry import DriverContext, DriverEntry


def _build(options: ReplayOptions, context: DriverContext) -> ReplayCamera:
    return ReplayCamera(options, context.name, context.clock)


CAMERA = DriverEntry("camera", ReplayOptions, _build, "a folder of images or a recorded run as a camera")
