"""The newest frame of each camera, for whoever looks; encoded at most once a frame however many do."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: A camera is looked at while somebody asked for its picture so long ago at most, s.
_WANTED_S = 5.0

_QUALITY = 80


@dataclass(frozen=True, eq=False)
class LatestFrame:
    """A frame: ``data`` ``(H, W)``, the camera's id, the host's monotonic clock, and its number in this slot."""

    data: NDArray[Any]
    frame_id: int
    host_time_ns: int
    number: int

    @property
    def age_s(self) -> float:
        """How long ago it came."""
        return max(time.monotonic_ns() - self.host_time_ns, 0) * 1e-9


class LatestFrames:
    """One slot a camera; safe to use from any thread. `put` never waits for a viewer."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._frames: dict[str, LatestFrame] = {}
        self._encoded: dict[tuple[str, int], tuple[int, bytes]] = {}
        self._encoding = threading.Lock()
        self._asked_s: dict[str, float] = {}

    def put(self, camera: str, frame: NDArray[Any], frame_id: int, host_time_ns: int) -> None:
        """The newest frame of a camera, in place of the one before; the image is copied."""
        data = np.array(frame)
        with self._condition:
            before = self._frames.get(camera)
            number = 1 if before is None else before.number + 1
            self._frames[camera] = LatestFrame(data, frame_id, host_time_ns, number)
            self._condition.notify_all()

    def get(self, camera: str) -> LatestFrame | None:
        """The newest frame, None while there was none."""
        self._asked_s[camera] = time.monotonic()
        return self._frames.get(camera)

    def wait_newer(self, camera: str, number: int, timeout_s: float) -> LatestFrame | None:
        """The newest frame once its number is above ``number``; None when none came in time."""
        self._asked_s[camera] = time.monotonic()
        with self._condition:
            there = self._condition.wait_for(lambda: self._number(camera) > number, timeout_s)
            return self._frames[camera] if there else None

    def wanted(self, camera: str) -> bool:
        """Whether somebody has asked for its picture lately."""
        asked_s = self._asked_s.get(camera)
        return asked_s is not None and time.monotonic() - asked_s < _WANTED_S

    def jpeg(self, camera: str, max_width_px: int = 1280) -> tuple[bytes, LatestFrame] | None:
        """The newest frame as a JPEG of that width at most, deeper images scaled to 8 bits; None without a frame."""
        frame = self.get(camera)
        if frame is None:
            return None
        with self._encoding:
            known = self._encoded.get((camera, max_width_px))
            if known is None or known[0] != frame.number:
                known = frame.number, _encoded(frame.data, max_width_px)
                self._encoded = {key: kept for key, kept in self._encoded.items() if key[0] != camera}
                self._encoded[camera, max_width_px] = known
        return known[1], frame

    def _number(self, camera: str) -> int:
        frame = self._frames.get(camera)
        return 0 if frame is None else frame.number


def _encoded(data: NDArray[Any], max_width_px: int) -> bytes:
    image = data
    if image.dtype != np.uint8:
        top = max(int(image.max()), 255)
        shift = max(top.bit_length() - 8, 0)
        image = (image >> shift).astype(np.uint8)
    if image.shape[1] > max_width_px:
        height = max(round(image.shape[0] * max_width_px / image.shape[1]), 1)
        image = cv2.resize(image, (max_width_px, height), interpolation=cv2.INTER_AREA)
    well, coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not well:
        raise ValueError(f"an image of {image.shape} {image.dtype} can not be encoded")
    return coded.tobytes()
