"""Ground truth of an acquisition on the digital twin: where the dots really were, and the floor."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bscd.acquisition import RunFile
from bscd.analysis.validation import Validation
from bscd.arrays import FloatArray
from drivers.interfaces import Frame

_LEFT = -1


class WitnessedCamera:
    """A twin's camera that remembers the world's state at each of its frames; else the camera itself."""

    def __init__(self, camera: Any, world: Any) -> None:
        self._camera = camera
        self._world = world
        self.states: dict[int, Any] = {}

    def snap(self, timeout_s: float = 5.0) -> Frame:
        """One frame, as the camera takes it."""
        frame = self._camera.snap(timeout_s)
        self.states[frame.frame_id] = self._world.state()
        return frame

    def __getattr__(self, name: str) -> Any:
        """Everything else is the camera's own."""
        return getattr(self._camera, name)


def with_truth(found: Validation, run: RunFile, camera: WitnessedCamera, world: Any) -> Validation:
    """The validation with the dots' true positions and with the floor (DESIGN section 3).

    The floor: the same measured pixels, reconstructed with the twin's exact rays instead of the calibration.
    """
    states = {record.y_mm: camera.states[record.frame_id] for record in run.frames(camera="primary")}
    truth, floor = np.empty((len(found.index), 3)), np.empty((len(found.index), 3))
    for y_mm in np.unique(found.y_mm):
        here = found.y_mm == y_mm
        state = states[y_mm]
        seen = next(view for view in world.dots("primary", state) if view.side == _LEFT)
        truth[here] = seen.xyz_mm[np.searchsorted(seen.index, found.index[here])]
        pixels = (found.left_px[here], found.right_px[here])
        floor[here] = _nearest_to_rays([world.rays("primary", xy, state) for xy in pixels])
    return replace(found, truth_mm=truth, floor_mm=floor)


def _nearest_to_rays(bundles: list[Any]) -> FloatArray:
    """The points ``(N, 3)`` nearest to N pairs of rays, least squares of the distances."""
    across = [np.eye(3) - rays.direction[:, :, None] * rays.direction[:, None, :] for rays in bundles]
    right = [np.einsum("nij,nj->ni", one, rays.origin_mm) for one, rays in zip(across, bundles, strict=True)]
    return np.linalg.solve(sum(across), np.sum(right, axis=0)[..., None])[..., 0]
