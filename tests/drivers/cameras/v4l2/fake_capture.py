"""A capture that behaves as OpenCV's on a V4L2 camera: runs freely, keeps four images, stamps their end."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from typing import Any

import cv2
import numpy as np


class FakeDevice:
    """The camera itself: one path, which several captures open one after the other; the faults are its."""

    def __init__(self, width=32, height=24, formats=("GREY", "Y12 ", "YUYV", "MJPG")):
        self.size = (width, height)
        self.formats = formats
        self.present = True
        self.silent = threading.Event()
        self.skip = 0
        self.break_images = 0
        self.garbled: deque[Any] = deque()
        """What `FakeCapture.retrieve` gives in place of the next images; an exception is raised."""
        self.broken_buffers = False
        self.late_s = 0.0
        self.open_error = 0
        """Why the kernel does not open it: a number of `errno`."""
        self.starting = 0
        """So often more it can not be opened, as while it starts up."""
        self.power_cycles = 0
        self.stamps = True
        self.opened = self.released = 0

    def open(self, path):
        assert path == "/dev/v4l/by-id/fake"
        if self.open_error:
            raise OSError(self.open_error, os.strerror(self.open_error), path)
        self.opened += 1
        self.starting = max(self.starting - 1, 0)
        return FakeCapture(self)

    def power_cycle(self, starting=0):
        """Off and on again: what had it open gets nothing more, though it is there all the time."""
        self.starting = starting + 1
        self.power_cycles += 1


class FakeCapture:
    def __init__(self, device: FakeDevice) -> None:
        self._device = device
        self._of = device.power_cycles
        self._opened = device.present and not device.starting
        self._properties = {cv2.CAP_PROP_FPS: 30.0, cv2.CAP_PROP_EXPOSURE: 156.0, cv2.CAP_PROP_GAIN: 0.0}
        self._next_s = time.monotonic()
        self._stamp_s = 0.0
        self._number = 0

    @property
    def _alive(self):
        return self._device.present and self._of == self._device.power_cycles

    def isOpened(self):
        return self._opened

    def get(self, key):
        if key == cv2.CAP_PROP_POS_MSEC:
            return 1e3 * self._stamp_s if self._device.stamps else 0.0
        return self._properties.get(key, 0.0)

    def set(self, key, value):
        if key == cv2.CAP_PROP_FOURCC and int(value).to_bytes(4, "little").decode() not in self._device.formats:
            value = float(int.from_bytes(b"YUYV", "little"))
        if key == cv2.CAP_PROP_FRAME_WIDTH:
            value = float(self._device.size[0])
        if key == cv2.CAP_PROP_FRAME_HEIGHT:
            value = float(self._device.size[1])
        self._properties[key] = float(value)
        return True

    def grab(self):
        if self._device.broken_buffers:
            raise cv2.error("(-215:Assertion failed) in function 'read_frame_v4l2'")
        while self._device.silent.is_set():
            time.sleep(0.005)
            if not self._alive:
                return False
        period_s = 1.0 / self._properties[cv2.CAP_PROP_FPS]
        skipped, self._device.skip = self._device.skip, 0
        self._next_s = max(self._next_s, time.monotonic() - 4 * period_s) + (1 + skipped) * period_s
        while (left_s := self._next_s - time.monotonic()) > 0:
            time.sleep(min(left_s, 0.02))
            if not self._alive:
                return False
        self._stamp_s = self._next_s
        self._number += 1 + skipped
        time.sleep(self._device.late_s)
        return self._alive

    def retrieve(self):
        if self._device.break_images > 0:
            self._device.break_images -= 1
            return True, np.zeros((2, 2), np.uint8)
        if self._device.garbled:
            garbled = self._device.garbled.popleft()
            if isinstance(garbled, Exception):
                raise garbled
            return garbled
        width, height = self._device.size
        level = 0.1 * self._properties[cv2.CAP_PROP_EXPOSURE] * 10 ** (self._properties[cv2.CAP_PROP_GAIN] / 200)
        letters = int(self._properties[cv2.CAP_PROP_FOURCC]).to_bytes(4, "little").decode()
        grey = np.full((height, width), min(level, 255.0), np.uint8)
        grey[0, 0] = self._number % 256
        if letters == "Y12 ":
            return True, grey.astype(np.uint16) << 4
        if letters == "YUYV":
            return True, np.stack([grey, np.full_like(grey, 128)], axis=2)
        if letters == "MJPG":
            return True, cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
        return True, grey

    def release(self):
        self._device.released += 1
