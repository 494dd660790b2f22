"""A world of a few pixels: the first row of each image shows the state, the rest a flat grey with noise."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from drivers.clock import Clock
from drivers.twin.options import TwinOptions

QUANTITIES = ("rotation_deg", "translation_mm", "jack_mm", "pressure_kpa")


class TinyWorld:
    def __init__(self, clock: Clock, *, shape: tuple[int, int] = (24, 32)) -> None:
        self.options = TwinOptions()
        self.clock = clock
        self.shape = shape
        self.sources: dict[str, Callable[[], float]] = {}
        self.exposures_s: list[float] = []

    def bind(self, quantity: str, source: Callable[[], float]) -> None:
        assert quantity in QUANTITIES
        self.sources[quantity] = source

    def now(self, quantity: str) -> float:
        return self.sources[quantity]()

    def optics(self, camera: str) -> SimpleNamespace:
        assert camera in ("primary", "auxiliary")
        return SimpleNamespace(width_px=self.shape[1], height_px=self.shape[0], pixel_size_mm=0.0067)

    def expose(self, camera: str, *, exposure_s: float, gain_db: float, rng: np.random.Generator) -> np.ndarray:
        self.exposures_s.append(self.clock.now_s())
        grey = 100.0 * exposure_s / 0.02 * 10.0 ** (gain_db / 20.0) + rng.normal(0.0, 2.0, self.shape)
        image = np.clip(np.round(grey), 0, 255).astype(np.uint8)
        for column, quantity in enumerate(QUANTITIES):
            if quantity in self.sources:
                image[0, column] = round(self.sources[quantity]()) % 256
        return image
