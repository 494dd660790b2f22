"""V4L2 cameras (USB UVC and the like) through OpenCV."""

from drivers.cameras.v4l2.camera import V4l2Camera
from drivers.cameras.v4l2.options import V4l2Options

__all__ = ["V4l2Camera", "V4l2Options"]
