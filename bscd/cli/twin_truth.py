"""Ground truth of what was measured on the digital twin: where dots and material points really were, and the floor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bscd.acquisition import FrameRecord, RunFile
from bscd.analysis.surface import fit_sphere
from bscd.analysis.validation import Validation
from bscd.arrays import FloatArray
from bscd.calibration.hull import Hull
from bscd.results import ResultsFile
from drivers.clock import Clock

_LEFT = -1


@dataclass(frozen=True, eq=False)
class Missed:
    """What T frames of a measurement miss of the truth.

    ``uvw_rms_mm`` ``(T, 3)`` are root mean squares of the errors in the membrane frame, NaN where no point is known;
    ``kept`` ``(T,)`` the share that is valid of the points that the camera sees on the speckled surface inside the
    calibrated volume.
    """

    uvw_rms_mm: FloatArray
    kept: FloatArray


class WitnessedWorld:
    """The twin's world that remembers its state at each exposure; else the world itself."""

    def __init__(self, world: Any, clock: Clock) -> None:
        self._world = world
        self._clock = clock
        self._states: dict[tuple[str, int], Any] = {}

    def expose(self, camera: str, **settings: Any) -> Any:
        """One exposure, as the world makes it."""
        state = self._world.state()
        self._states[camera, round(self._clock.now_s() * 1e9)] = state
        return self._world.expose(camera, state=state, **settings)

    def state_at(self, record: FrameRecord) -> Any:
        """The state that a frame of a recording shows."""
        return self._states[record.camera, record.camera_time_ns]

    def __getattr__(self, name: str) -> Any:
        """Everything else is the world's own."""
        return getattr(self._world, name)


def with_truth(found: Validation, run: RunFile, world: WitnessedWorld) -> Validation:
    """The validation with the dots' true positions and with the floor (DESIGN section 3).

    The floor: the same measured pixels, reconstructed with the twin's exact rays instead of the calibration.
    """
    states = {
        (record.phase == "bsc-face", record.y_mm): world.state_at(record) for record in run.frames(camera="primary")
    }
    truth, floor = np.empty((len(found.index), 3)), np.empty((len(found.index), 3))
    for (face_pose, y_mm), state in states.items():
        here = (found.face_pose == face_pose) & (found.y_mm == y_mm)
        seen = next(view for view in world.dots("primary", state) if view.side == _LEFT)
        truth[here] = seen.xyz_mm[np.searchsorted(seen.index, found.index[here])]
        pixels = (found.left_px[here], found.right_px[here])
        floor[here] = _nearest_to_rays([world.rays("primary", xy, state) for xy in pixels])
    return replace(found, truth_mm=truth, floor_mm=floor)


def missed_of_truth(results: ResultsFile, run: RunFile, world: WitnessedWorld, hull: Hull) -> Missed:
    """What each frame of an inflation's results misses of the twin's truth.

    The truth of a point is the displacement of the material that its pixel shows in the reference.
    """
    frame = results.header.membrane
    rms, kept = np.full((len(results), 3), np.nan), np.full(len(results), np.nan)
    if frame is None:
        return Missed(rms, kept)
    states = [world.state_at(record) for record in run.frames("primary", "inflation")]
    rest = states[results.header.reference_frames[0]]
    seen = world.surface("primary", results.points_px, rest)
    speckled = seen.speckled & np.isfinite(seen.material_mm).all(axis=1)
    material = np.where(speckled[:, None], seen.material_mm, 0.0)
    at_rest = world.surface_positions(material, rest)
    inside = speckled & hull.contains(at_rest)
    for place, measured in enumerate(results.frames()):
        position = world.surface_positions(material, states[measured.number])
        error = (measured.uvw_mm - (position - at_rest) @ frame.axes.T)[measured.valid & speckled]
        if error.size:
            rms[place] = np.sqrt(np.mean(error**2, axis=0))
        staying = inside & hull.contains(position)
        if staying.any():
            kept[place] = measured.valid[staying].mean()
    return Missed(rms, kept)


def true_centre_mm(results: ResultsFile, run: RunFile, world: WitnessedWorld) -> FloatArray:
    """The centre ``(3,)`` of the sphere that a run shows: that of the true points of its surface."""
    state = world.state_at(next(run.frames("primary", "sphere")))
    seen = world.surface("primary", results.points_px, state)
    speckled = seen.speckled & np.isfinite(seen.material_mm).all(axis=1)
    return fit_sphere(world.surface_positions(seen.material_mm[speckled], state)).centre_mm


def _nearest_to_rays(bundles: list[Any]) -> FloatArray:
    """The points ``(N, 3)`` nearest to N pairs of rays, least squares of the distances."""
    across = [np.eye(3) - rays.direction[:, :, None] * rays.direction[:, None, :] for rays in bundles]
    right = [np.einsum("nij,nj->ni", one, rays.origin_mm) for one, rays in zip(across, bundles, strict=True)]
    return np.linalg.solve(sum(across), np.sum(right, axis=0)[..., None])[..., 0]
