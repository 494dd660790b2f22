"""A folder of images as another program would leave it: another rig's geometry, only pictures and a manifest."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from drivers.twin.options import (
    AuxiliaryGeometry,
    CameraGeometry,
    LightOptions,
    PrismOptions,
    SceneName,
    SensorOptions,
    StageOptions,
    TwinOptions,
)
from drivers.twin.placement import RigState
from drivers.twin.world import CameraId, World

HEADER = ("file", "camera", "phase", "target_position", "y_mm", "rotation_deg", "pressure_kpa", "time_s")

RAISED_MM, LOWERED_MM = 70.0, 5.0

#: Misaligned prism, another lens and distance, off-centre target, another noise than the paper's rig.
OPTIONS = TwinOptions(
    primary=CameraGeometry(
        focal_length_mm=66.0,
        distortion=(0.6, 0.0, 0.002, -0.001),
        position_mm=(2.5, -560.0, -3.0),
        looks_at_mm=(0.0, 0.0, -1.0),
        roll_deg=0.4,
        principal_offset_px=(12.0, -9.0),
    ),
    auxiliary=AuxiliaryGeometry(
        focal_length_mm=64.0, distortion=(0.3, 0.0, 0.0, 0.0), position_mm=(-175.0, -530.0, 8.0), roll_deg=-0.6
    ),
    prism=PrismOptions(edge_mm=(0.8, -188.0, 0.7), tilt_deg=(-0.7, 0.8, 0.6)),
    stages=StageOptions(rotation_axis_mm=(-1.2, 12.0), rotation_tilt_deg=(-0.3, 0.2), translation_tilt_deg=(-0.3, 0.4)),
    light=LightOptions(level=0.6, gradient_per_mm=(-0.003, 0.001, 0.002), background=0.05),
    sensor=SensorOptions(noise_grey=3.0, noise="gaussian", blur_px=0.9),
)

TARGET = "[target]\ncolumns = 9\nrows = 23\npitch_mm = 2.0\ndot_diameter_mm = 1.0\nmargin_mm = 2.0\n"


class ForeignRig:
    """Renders images of a rig whose numbers the calibration never sees."""

    def __init__(self, options: TwinOptions = OPTIONS, seed: int = 0) -> None:
        self.world = World(options)
        self.rng = np.random.default_rng(seed)

    def state(self, rotation_deg: float, y_mm: float, jack_mm: float):
        return self.world.state()._replace(rotation_deg=rotation_deg, translation_mm=50.0 + y_mm, jack_mm=jack_mm)

    def image(self, camera: str, rotation_deg: float, y_mm: float, jack_mm: float) -> np.ndarray:
        state = self.state(rotation_deg, y_mm, jack_mm)
        return self.world.expose(camera, exposure_s=0.02, gain_db=0.0, rng=self.rng, state=state)

    def write(self, folder: Path, positions: range, step_mm: float, rotation: bool = True) -> None:
        """Both scans in one manifest."""
        steps = [("corner", 0), *(("face", k) for k in positions)]
        self._finish(folder, self._scans(folder, steps, step_mm, rotation))

    def write_all(self, folder: Path, positions: range, step_mm: float, pressures_kpa: Sequence[float]) -> None:
        """Both scans in both poses, a sphere through the prism and by the pair, and an inflation, in one manifest.

        Nothing tells where the prism was: the pair's images of the sphere share their time. The inflation's pressure
        is known now and then.
        """
        steps = [(pose, k) for pose in ("corner", "face") for k in positions]
        rows = self._scans(folder, steps, step_mm, rotation=True)
        for name, camera, jack_mm, time_s in (
            ("sphere_prism_0", "primary", RAISED_MM, 1.0),
            ("sphere_prism_1", "primary", RAISED_MM, 2.0),
            ("sphere_pair_primary", "primary", LOWERED_MM, 3.0),
            ("sphere_pair_auxiliary", "auxiliary", LOWERED_MM, 3.0),
        ):
            cv2.imwrite(str(folder / f"{name}.png"), self.shown(camera, self.object_state("sphere", jack_mm)))
            rows.append((f"{name}.png", camera, "sphere", "", "", "", "", time_s))
        for k, pressure_kpa in enumerate(pressures_kpa):
            state = self.object_state("membrane", RAISED_MM, pressure_kpa)
            cv2.imwrite(str(folder / f"inflation_{k:02d}.png"), self.shown("primary", state))
            known = f"{pressure_kpa:.3f}" if k % 3 == 0 else ""
            rows.append((f"inflation_{k:02d}.png", "primary", "inflation", "", "", "", known, ""))
        self._finish(folder, rows)

    def object_state(self, scene: SceneName, jack_mm: float, pressure_kpa: float = 0.0) -> RigState:
        """The sphere or the membrane, where its options say."""
        self.world.place(scene)
        return self.world.quantised(self.world.state()._replace(jack_mm=jack_mm, pressure_kpa=pressure_kpa))

    def shown(self, camera: CameraId, state: RigState) -> np.ndarray:
        """One exposure of a state."""
        return self.world.expose(camera, exposure_s=0.02, gain_db=0.0, rng=self.rng, state=state)

    def _scans(self, folder: Path, steps: Sequence[tuple[str, int]], step_mm: float, rotation: bool) -> list[tuple]:
        rows = []
        for kind, cameras, jack_mm in (("reference", ("primary", "auxiliary"), 5.0), ("bsc", ("primary",), 70.0)):
            for pose, k in steps:
                rotation_deg = 45.0 if pose == "corner" else 0.0
                for camera in cameras:
                    name = f"{kind}_{pose}_{k:+d}_{camera}.png"
                    cv2.imwrite(str(folder / name), self.image(camera, rotation_deg, k * step_mm, jack_mm))
                    reading = f"{rotation_deg}" if rotation else ""
                    rows.append((name, camera, f"{kind}-{pose}", k, k * step_mm, reading, "", ""))
        return rows

    @staticmethod
    def _finish(folder: Path, rows: list[tuple]) -> None:
        with (folder / "manifest.csv").open("w", newline="") as file:
            csv.writer(file).writerows([HEADER, *rows])
        (folder / "rig.toml").write_text(TARGET)
