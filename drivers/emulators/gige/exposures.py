"""Frames as bytes, exposed ahead of time and kept, so that serving one costs a copy."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.emulators.gige.formats import encode

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class Readout:
    """How the sensor is exposed and which part of it is read, in which form; all in binned pixels."""

    exposure_s: float
    gain_db: float
    x_px: int
    y_px: int
    width_px: int
    height_px: int
    binning: tuple[int, int]
    pixel_format: int

    def content(self, image: NDArray[Any], sensor_bits: int) -> bytes:
        """The bytes of a full image; bins are averaged, and what lies outside the sensor is black."""
        across, down = self.binning
        if self.binning != (1, 1):
            height, width = image.shape[0] // down, image.shape[1] // across
            blocks = image[: height * down, : width * across].reshape(height, down, width, across)
            image = np.round(blocks.mean(axis=(1, 3))).astype(image.dtype)
        part = image[self.y_px : self.y_px + self.height_px, self.x_px : self.x_px + self.width_px]
        if part.shape != (self.height_px, self.width_px):
            missing = (self.height_px - part.shape[0], self.width_px - part.shape[1])
            part = np.pad(part, ((0, missing[0]), (0, missing[1])))
        return encode(part, sensor_bits, self.pixel_format)


class Exposures:
    """Keeps a few frames of the present state of the world, each with noise of its own; ends with `close`.

    A change of the state or the settings makes the next frame on the spot. At a rate above what the thread can
    make (about 50 full frames a second) frames that were sent come again, noise included.

    Parameters
    ----------
    expose : callable
        ``expose(exposure_s, gain_db)``: the sensor's image now.
    state : callable
        What the image depends on beside the settings; equal states look alike.
    sensor_bits : int
        Bits of a pixel of ``expose``.
    ahead : int
        How many frames are kept.
    """

    def __init__(
        self, expose: Callable[[float, float], Image], state: Callable[[], Any], sensor_bits: int, ahead: int = 4
    ) -> None:
        self._expose = expose
        self._state = state
        self._sensor_bits = sensor_bits
        self._ahead = ahead
        self._change = threading.Condition()
        self._key: tuple[Any, Readout] | None = None
        self._fresh: deque[bytes] = deque()
        self._sent: deque[bytes] = deque(maxlen=ahead)
        self._running = True
        self._thread = threading.Thread(target=self._expose_ahead, name="gige-exposures", daemon=True)
        self._thread.start()

    def take(self, readout: Readout) -> bytes:
        """The bytes of the next frame; raises what the exposure raised."""
        key = (self._state(), readout)
        with self._change:
            if key != self._key:
                self._key = key
                self._fresh.clear()
                self._sent.clear()
            if self._fresh:
                content = self._fresh.popleft()
            elif self._sent:
                content = self._sent.popleft()
            else:
                content = None
            self._change.notify()
        if content is None:
            content = self._make(readout)
        with self._change:
            if key == self._key:
                self._sent.append(content)
        return content

    def close(self) -> None:
        """End the thread; may be called twice."""
        with self._change:
            self._running = False
            self._change.notify()
        self._thread.join(timeout=30.0)

    def _make(self, readout: Readout) -> bytes:
        return readout.content(self._expose(readout.exposure_s, readout.gain_db), self._sensor_bits)

    def _expose_ahead(self) -> None:
        while True:
            with self._change:
                while self._running and (self._key is None or len(self._fresh) >= self._ahead):
                    self._change.wait(1.0)
                if not self._running:
                    return
                key = self._key
            if key is None or key[0] != self._state():  # the next frame is made on the spot
                with self._change:
                    if self._running:
                        self._change.wait(1.0)
                continue
            try:
                content = self._make(key[1])
            except Exception:  # the frame that needs it will raise it
                with self._change:
                    self._change.wait(1.0)
                continue
            with self._change:
                if key == self._key and key[0] == self._state():
                    self._fresh.append(content)
