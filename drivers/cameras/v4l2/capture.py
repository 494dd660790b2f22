"""An open capture of OpenCV: its controls in our units, its images as grey levels."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.cameras.v4l2.availability import require_free
from drivers.cameras.v4l2.options import BITS, V4l2Options
from drivers.errors import DeviceBusyError, NotConnectedError, OutOfLimitsError

EXPOSURE_STEP_S = 1e-4
_MANUAL_EXPOSURE = 1  # V4L2_EXPOSURE_MANUAL

Grey = NDArray[np.uint8] | NDArray[np.uint16]


class Capture(Protocol):
    """The part of `cv2.VideoCapture` that the driver uses."""

    def isOpened(self) -> bool:  # noqa: N802
        """Whether it was opened."""
        ...

    def get(self, property_id: int, /) -> float:
        """A property's value."""
        ...

    def set(self, property_id: int, value: float, /) -> bool:
        """Set a property; False when it can not be set."""
        ...

    def grab(self) -> bool:
        """Wait for the next image; False when none came."""
        ...

    def retrieve(self) -> tuple[bool, Any]:
        """The image that was grabbed."""
        ...

    def release(self) -> None:
        """Close it."""
        ...


OpenCapture = Callable[[str], Capture]


def open_v4l2(path: str) -> Capture:
    """OpenCV's capture of a V4L2 device. Raises `OSError` with the kernel's reason when it can not be had.

    What OpenCV would write to stderr besides is told by our errors; ``OPENCV_LOG_LEVEL`` brings it back.
    """
    require_free(path)
    if "OPENCV_LOG_LEVEL" not in os.environ:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    return cv2.VideoCapture(path, cv2.CAP_V4L2)


@dataclass(frozen=True, slots=True)
class Settings:
    """What can be changed while connected."""

    exposure_s: float
    gain_db: float
    frame_rate_hz: float


def open_camera(open_capture: OpenCapture, options: V4l2Options, name: str) -> Capture:
    """The device, open and in its format.

    Raises `NotConnectedError` when it can not be opened, `DeviceBusyError` when another program has it,
    `OutOfLimitsError` when it does not take size or format.
    """
    try:
        capture = open_capture(options.device)
    except OSError as error:
        raise _not_opened(name, options.device, error) from error
    if not capture.isOpened():
        capture.release()
        hint = "check the path (ls /dev/v4l/by-id), the group video, and that no other program has it"
        raise NotConnectedError(name, f"connecting: {options.device} can not be opened", hint)
    raw = options.pixel_format != "MJPG"
    wanted = {
        cv2.CAP_PROP_FOURCC: float(_code(options.pixel_format)),
        cv2.CAP_PROP_FRAME_WIDTH: float(options.width_px),
        cv2.CAP_PROP_FRAME_HEIGHT: float(options.height_px),
    }
    for key, value in wanted.items():
        capture.set(key, value)
    capture.set(cv2.CAP_PROP_CONVERT_RGB, 0.0 if raw else 1.0)
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE)
    got = {key: capture.get(key) for key in wanted}
    if got != wanted:
        capture.release()
        code, width, height = (int(value) for value in got.values())
        letters = code.to_bytes(4, "little").decode(errors="replace")
        raise OutOfLimitsError(
            name,
            f"connecting: it does not take {options.width_px} x {options.height_px} {options.pixel_format!r}",
            f"it offers {width} x {height} {letters!r}; see v4l2-ctl --list-formats-ext",
        )
    return capture


def apply(capture: Capture, settings: Settings, options: V4l2Options) -> Settings:
    """Set exposure, gain and rate; returns what the camera made of them, by its own word where it has one."""
    capture.set(cv2.CAP_PROP_FPS, settings.frame_rate_hz)
    capture.set(cv2.CAP_PROP_EXPOSURE, round(settings.exposure_s / EXPOSURE_STEP_S))
    capture.set(cv2.CAP_PROP_GAIN, round(settings.gain_db / options.gain_step_db))
    rate_hz, exposure = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_EXPOSURE)
    return Settings(
        exposure_s=exposure * EXPOSURE_STEP_S if exposure > 0 else settings.exposure_s,
        gain_db=capture.get(cv2.CAP_PROP_GAIN) * options.gain_step_db,
        frame_rate_hz=rate_hz if rate_hz > 0 else settings.frame_rate_hz,
    )


def time_stamp_ns(capture: Capture) -> int | None:
    """The driver's time stamp of the image grabbed last, ns of the host's monotonic clock; None without one."""
    stamp_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
    return round(1e6 * stamp_ms) if stamp_ms > 0 else None


def grabbed(capture: Capture) -> bool:
    """Whether another image came; OpenCV may also raise, when the driver's buffer is not what it was."""
    try:
        return capture.grab()
    except cv2.error:
        return False


def grey_image(capture: Capture, options: V4l2Options) -> Grey | None:
    """The image grabbed last, read-only; None when it is not whole."""
    try:
        whole, image = capture.retrieve()
        image = _luma(image) if whole and image is not None else None
    except cv2.error:
        return None
    bits = BITS[options.pixel_format]
    kind = np.uint8 if bits == 8 else np.uint16
    if image is None or image.shape != (options.height_px, options.width_px) or image.dtype != kind:
        return None
    if 8 < bits < 16 and int(image.max()) >> bits:  # bits that the format does not have
        return None
    image = image.copy()  # OpenCV may use its own again
    image.setflags(write=False)
    return image


def _luma(image: NDArray[Any]) -> NDArray[Any]:
    """The grey levels of an image of one, two (YUYV) or three (BGR) channels; others as they are."""
    if image.ndim != 3 or image.shape[2] == 0:
        return image
    return image[:, :, 0] if image.shape[2] < 3 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def _not_opened(name: str, path: str, error: OSError) -> NotConnectedError | DeviceBusyError:
    if error.errno == errno.EBUSY:
        return DeviceBusyError(name, f"connecting: another program has {path}", "end that program")
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        hint = "check its cable and the path (ls /dev/v4l/by-id)"
        return NotConnectedError(name, f"connecting: there is no {path}", hint)
    if error.errno in (errno.EACCES, errno.EPERM):
        return NotConnectedError(name, f"connecting: not allowed to open {path}", "add this user to the group video")
    words = f"connecting: {path} can not be opened as a camera ({error.strerror})"
    return NotConnectedError(name, words, "check the path (ls /dev/v4l/by-id)")


def _code(letters: str) -> int:
    return int.from_bytes(letters.encode(), "little")
