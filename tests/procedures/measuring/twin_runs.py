"""Runs of sphere and membrane on the twin, and the truth about what they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from bscd.acquisition import CameraMeta, FrameRecord, RunWriter
from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import Calibration, CalibrationChoices, calibrate
from drivers.clock import VirtualClock
from drivers.twin.options import TwinOptions
from drivers.twin.placement import RigState
from drivers.twin.world import World
from tests.calibration.exact_rig import ExactRig

CAMERA = CameraMeta(1280, 1024, 8, 0.0067)
RAISED_MM, LOWERED_MM = 70.0, 5.0
REST_KPA = 0.05
PRESSURES_KPA = (*[REST_KPA] * 3, *np.linspace(REST_KPA, 16.0, 10)[1:])


def wide_calibration() -> Calibration:
    """Through the biprism, from exact images of the dots of both scans with a hundredth of a pixel of noise."""
    rig = ExactRig(noise_px=0.01)
    steps = {"poses": ("face", "corner"), "positions": range(-8, 9, 2)}
    return calibrate(
        rig.reference(**steps),
        rig.bsc(**steps),
        rig.target,
        (CAMERA.width_px, CAMERA.height_px),
        CalibrationChoices(),
        jack_mm=RAISED_MM,
    )


def narrowed(wide: Calibration) -> Calibration:
    """The calibration by the control points of its middle alone."""
    control = wide.control
    inner = np.abs(control.distorted_mm[:, 0] - 0.6) < 8.0
    parts = {name: getattr(control, name)[inner] for name in control.__dataclass_fields__}
    return replace(wide, control=replace(control, **parts))


class TwinRuns:
    """The twin's world with its pictures and truth; images are rendered once a state."""

    def __init__(self) -> None:
        self.options = TwinOptions()
        self.world = World(self.options, clock=VirtualClock())
        self._rng = np.random.default_rng(5)

    @cached_property
    def sphere_state(self) -> RigState:
        self.world.place("sphere")
        return self.world.quantised(self.world.state()._replace(jack_mm=RAISED_MM))

    @cached_property
    def membrane_state(self) -> RigState:
        self.world.place("membrane")
        return self.world.quantised(self.world.state()._replace(jack_mm=RAISED_MM))

    def inflated(self, pressure_kpa: float) -> RigState:
        return self.world.quantised(self.membrane_state._replace(pressure_kpa=pressure_kpa))

    def image(self, state: RigState, camera="primary", noise_times: float = 1.0) -> np.ndarray:
        """One exposure; ``noise_times`` 2 is a quarter of the light's worth of noise."""
        image = self.world.expose(camera, exposure_s=0.02, gain_db=0.0, rng=self._rng, state=state)
        if noise_times == 1.0:
            return image
        again = self.world.expose(camera, exposure_s=0.02, gain_db=0.0, rng=self._rng, state=state)
        extra = (image.astype(float) - again) * np.sqrt((noise_times**2 - 1.0) / 2.0)
        third = self.world.expose(camera, exposure_s=0.02, gain_db=0.0, rng=self._rng, state=state)
        return np.clip(np.rint(third + extra), 0, 255).astype(np.uint8)

    def sphere(self, noise_times: float = 1.0) -> list[FrameRecord]:
        """Four frames through the biprism, and two of each camera with it lowered."""
        self._rng = np.random.default_rng(6)  # the same pictures whoever asks first
        low = self.sphere_state._replace(jack_mm=LOWERED_MM)
        taken = [
            *[("primary", self.sphere_state, RAISED_MM)] * 4,
            ("primary", low, LOWERED_MM),
            ("auxiliary", low, LOWERED_MM),
            ("primary", low, LOWERED_MM),
            ("auxiliary", low, LOWERED_MM),
        ]
        return [
            FrameRecord(
                camera, "sphere", self.image(state, camera, noise_times), frame_id=k, jack_mm=jack, time_s=k / 11
            )
            for k, (camera, state, jack) in enumerate(taken)
        ]

    def inflation(self, pressures_kpa: Sequence[float], noise_times: float = 1.0) -> list[FrameRecord]:
        self._rng = np.random.default_rng(5)
        return [
            self.frame(self.image(self.inflated(p), noise_times=noise_times), k, p) for k, p in enumerate(pressures_kpa)
        ]

    @staticmethod
    def frame(image: np.ndarray, number: int, pressure_kpa: float = float("nan")) -> FrameRecord:
        return FrameRecord(
            "primary",
            "inflation",
            image,
            frame_id=number,
            jack_mm=RAISED_MM,
            pressure_kpa=pressure_kpa,
            time_s=number / 11,
        )

    def material(self, points_px: FloatArray, state: RigState) -> tuple[FloatArray, BoolArray]:
        """The speckled surface's material points that pixels see, and where there are any."""
        seen = self.world.surface("primary", points_px, state)
        good = seen.speckled & np.isfinite(seen.material_mm).all(axis=1)
        return np.where(good[:, None], seen.material_mm, 0.0), good

    def principal_strain(self, material_mm: FloatArray, reference: RigState, now: RigState) -> FloatArray:
        """Green-Lagrange principal strains ``(N, 2)``, the larger first, from the material's metric."""
        small = 1e-4

        def metric(state: RigState) -> FloatArray:
            along = [
                (
                    self.world.surface_positions(material_mm + np.array(step), state)
                    - self.world.surface_positions(material_mm - np.array(step), state)
                )
                / (2.0 * small)
                for step in ((small, 0.0), (0.0, small))
            ]
            tangents = np.stack(along, axis=2)
            return np.swapaxes(tangents, 1, 2) @ tangents

        stretches = np.linalg.eigvals(np.linalg.solve(metric(reference), metric(now))).real
        return np.sort((stretches - 1.0) / 2.0, axis=1)[:, ::-1]


def write(path: Path, frames: Sequence[FrameRecord], cameras=("primary",), camera: CameraMeta = CAMERA) -> Path:
    with RunWriter(path, title=path.stem, cameras=dict.fromkeys(cameras, camera)) as run:
        for record in frames:
            run.append(record)
    return path
