"""The digital twin's one physical state, shared by all simulated devices, and what the cameras see of it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, HostClock
from drivers.twin.dots import DotView, see_dots
from drivers.twin.optics import Biprism, CameraOptics, FloatArray, look_at, rotation_xyz_deg
from drivers.twin.options import CameraGeometry, SceneName, TwinOptions
from drivers.twin.placement import Placement, Pose, RigState, object_pose
from drivers.twin.scene import SurfacePoints, meet_surface, render_scene, surface_positions
from drivers.twin.sensor import FloatImage, blur, digitise, vignette
from drivers.twin.store import FrameStore
from drivers.twin.trace import DIRECT, Rays, project, trace_pixels

CameraId = Literal["primary", "auxiliary"]
Quantity = Literal["rotation_deg", "translation_mm", "jack_mm", "pressure_kpa"]


def camera_optics(geometry: CameraGeometry) -> CameraOptics:
    """The traceable camera of validated options."""
    shift = geometry.principal_offset_px
    return CameraOptics(
        focal_length_mm=geometry.focal_length_mm,
        pixel_size_mm=geometry.pixel_size_mm,
        width_px=geometry.width_px,
        height_px=geometry.height_px,
        principal_px=((geometry.width_px - 1) / 2.0 + shift[0], (geometry.height_px - 1) / 2.0 + shift[1]),
        distortion=geometry.distortion,
        position_mm=geometry.position_mm,
        rotation=look_at(np.array(geometry.position_mm), np.array(geometry.looks_at_mm), geometry.roll_deg),
    )


def _vector(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


class World:
    """The rig's physical state and its images.

    Devices tell where they are (`bind`); everything that is asked for a state, images and truth alike, uses the
    same quantised `RigState`, so they can not differ. All methods may be called from any thread; `close` ends the
    thread that renders ahead.
    """

    def __init__(self, options: TwinOptions, *, clock: Clock | None = None) -> None:
        self.options = options
        self.clock: Clock = clock or HostClock()
        self._optics = {"primary": camera_optics(options.primary), "auxiliary": camera_optics(options.auxiliary)}
        self._vignettes = {name: vignette(optics, options.light.vignetting) for name, optics in self._optics.items()}
        self._sources: dict[str, Callable[[], float]] = {}
        self._lock = threading.Lock()
        self._scene: SceneName = options.scene
        self._placement = Placement()
        self._store = FrameStore(self._render, options.store.memory_mb * 1_000_000)
        self.place(options.scene)

    def bind(self, quantity: Quantity, source: Callable[[], float]) -> None:
        """Take a quantity from a device from now on; unbound quantities keep the options' rest values."""
        if quantity not in type(self.options.rest).model_fields:
            raise ValueError(f"the twin's world has no quantity {quantity!r}")
        with self._lock:
            self._sources[quantity] = source

    def place(
        self,
        scene: SceneName,
        *,
        shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Put an object on the stage by hand, shifted and turned (about its middle) from its nominal mount.

        The cube mounts in the corner pose at POS.0; sphere and membrane go where their options say, whatever the
        stages read now, and ride on the stages from there.
        """
        if scene not in ("empty", "cube", "sphere", "membrane"):
            raise ValueError(f"no scene {scene!r}; known: empty, cube, sphere, membrane")
        rotation, translation = self._read("rotation_deg"), self._read("translation_mm")
        with self._lock:
            self._scene = scene
            if scene in ("cube", "empty"):
                rotation = translation = 0.0
            self._placement = Placement(_vector(shift_mm), _vector(turn_deg), rotation, translation)

    def state(self) -> RigState:
        """The state of the rig now."""
        rotation, translation = self._read("rotation_deg"), self._read("translation_mm")
        jack, pressure = self._read("jack_mm"), self._read("pressure_kpa")
        with self._lock:
            return RigState(rotation, translation, jack, pressure, self._scene, self._placement)

    def quantised(self, state: RigState) -> RigState:
        """A state made by hand, rounded as `state` rounds, so that prepared frames are found again."""
        return state._replace(
            **{q: self._round(q, getattr(state, q)) for q in ("rotation_deg", "translation_mm", "jack_mm")},
            pressure_kpa=max(self._round("pressure_kpa", state.pressure_kpa), 0.0),
        )

    def optics(self, camera: CameraId) -> CameraOptics:
        """The camera's exact optics."""
        return self._optics[camera]

    def prism(self, state: RigState | None = None) -> Biprism:
        """The biprism at the height that the jacks give it."""
        options = self.options.prism
        jack_mm = self._settled(state).jack_mm
        x, y, z = options.edge_mm
        return Biprism(
            refractive_index=options.refractive_index,
            alpha_deg=options.alpha_deg,
            thickness_mm=options.thickness_mm,
            width_mm=options.width_mm,
            height_mm=options.height_mm,
            edge_mm=(x, y, z + jack_mm - options.raised_mm),
            rotation=rotation_xyz_deg(*options.tilt_deg),
        )

    def sides(self, camera: CameraId, state: RigState | None = None) -> tuple[int, ...]:
        """Which views the sensor has now: 0 past the prism, -1 and 1 through its left and right roof faces.

        Sampled on a grid over the sensor; a half-lowered prism gives all three.
        """
        optics = self._optics[camera]
        columns = np.linspace(-0.5, optics.width_px - 0.5, 41)
        rows = np.linspace(-0.5, optics.height_px - 0.5, 41)
        grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        found = np.unique(trace_pixels(optics, self.prism(state), grid).side)
        return tuple(int(side) for side in found if abs(side) <= 1)

    def rays(self, camera: CameraId, pixels_px: FloatArray, state: RigState | None = None) -> Rays:
        """Exact rays in object space of pixels ``(N, 2)``."""
        return trace_pixels(self._optics[camera], self.prism(state), pixels_px)

    def project(self, camera: CameraId, points_mm: FloatArray, side: int, state: RigState | None = None) -> FloatArray:
        """Exact images ``(N, 2)`` px of world points ``(N, 3)`` mm: ``side`` -1, 1 through a roof face, 0 past it.

        NaN where no such ray exists. Neither occlusion nor the sensor's borders are looked at.
        """
        return project(self._optics[camera], self.prism(state), points_mm, side)

    def dots(self, camera: CameraId, state: RigState | None = None) -> list[DotView]:
        """The truth about the cube's dots, a `DotView` for each of `sides`; empty without a cube."""
        state = self._settled(state)
        if state.scene != "cube":
            return []
        pose, prism, optics = object_pose(self.options, state), self.prism(state), self._optics[camera]
        return [see_dots(self.options, optics, prism, pose, side) for side in self.sides(camera, state)]

    def object_pose(self, state: RigState | None = None) -> Pose:
        """Where the object on the stage is: its own frame in the world (`drivers.twin.placement.nominal_pose`)."""
        return object_pose(self.options, self._settled(state))

    def surface(self, camera: CameraId, pixels_px: FloatArray, state: RigState | None = None) -> SurfacePoints:
        """The truth about the speckled surface: which material point each pixel ``(N, 2)`` sees, and where it is."""
        state = self._settled(state)
        return meet_surface(self.options, self.rays(camera, pixels_px, state), state)

    def surface_positions(self, material_mm: FloatArray, state: RigState | None = None) -> FloatArray:
        """Where material points ``(N, 2)`` of the speckled surface are in a state, ``(N, 3)`` mm in the world."""
        return surface_positions(self.options, material_mm, self._settled(state))

    def irradiance(self, camera: CameraId, state: RigState | None = None) -> FloatImage:
        """Noise-free image ``(H, W)``, 1 = full scale at nominal exposure; read-only, kept by state."""
        return self._store.get(self._key(camera, self._settled(state)))

    def expose(
        self,
        camera: CameraId,
        *,
        exposure_s: float,
        gain_db: float,
        rng: np.random.Generator,
        state: RigState | None = None,
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """One exposure ``(H, W)`` in grey levels, with noise from ``rng``."""
        irradiance = self.irradiance(camera, state)
        return digitise(irradiance, self.options.sensor, exposure_s=exposure_s, gain_db=gain_db, rng=rng)

    def prepare(self, camera: CameraId, states: Sequence[RigState]) -> None:
        """Render these states' frames in the background; returns at once."""
        self._store.prepare([self._key(camera, state) for state in states])

    def wait(self) -> None:
        """Return when everything prepared is rendered."""
        self._store.wait()

    def close(self) -> None:
        """End the background thread and forget all frames; the world can still be used."""
        self._store.close()

    def _settled(self, state: RigState | None) -> RigState:
        return self.state() if state is None else self.quantised(state)

    def _round(self, quantity: str, value: float) -> float:
        name, _, unit = quantity.rpartition("_")
        step = getattr(self.options.store, f"{name}_step_{unit}")
        return round(round(value / step) * step, 9)

    def _read(self, quantity: str) -> float:
        with self._lock:
            source = self._sources.get(quantity)
        value = source() if source is not None else getattr(self.options.rest, quantity)
        value = self._round(quantity, float(value))
        return max(value, 0.0) if quantity == "pressure_kpa" else value

    def _key(self, camera: CameraId, state: RigState) -> tuple[CameraId, RigState, bool]:
        """What the image depends on: pressure and stages only where they move something, jacks in view only."""
        state = self.quantised(state)
        through_prism = self.sides(camera, state) != (DIRECT,)
        if not through_prism:
            state = state._replace(jack_mm=0.0)
        if state.scene != "membrane":
            state = state._replace(pressure_kpa=0.0)
        if state.scene == "empty":
            state = state._replace(rotation_deg=0.0, translation_mm=0.0, placement=Placement())
        return camera, state, through_prism

    def _render(self, key: tuple[CameraId, RigState, bool]) -> FloatImage:
        camera, state, through_prism = key
        optics = self._optics[camera]
        sharp = render_scene(self.options, optics, self.prism(state) if through_prism else None, state)
        return blur(sharp * self._vignettes[camera], self.options.sensor.blur_px)
