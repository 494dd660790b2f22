"""What the registry knows of the V4L2 driver."""

from __future__ import annotations

from drivers.cameras.v4l2.camera import V4l2Camera
from drivers.cameras.v4l2.options import V4l2Options
from drivers.ports import video_devices
from drivers.registry import DriverEntry

CAMERA = DriverEntry(
    "camera", V4l2Options, V4l2Camera, "a V4L2 camera (USB UVC and the like), through OpenCV", find=video_devices
)
