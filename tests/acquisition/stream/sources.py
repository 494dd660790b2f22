"""An in-process source: frames whose content follows from their number, so that any reader can tell what they were."""

import numpy as np

from bscd.acquisition import CameraMeta, FrameRecord

#: Speckles with a camera's noise; a frame is a part of it that its number chooses, the number in its first pixels.
_TEXTURES: dict[tuple[int, int], np.ndarray] = {}


def texture(shape):
    if shape not in _TEXTURES:
        rng = np.random.default_rng(shape[0])
        rows, columns = np.ogrid[: shape[0] + 16, : shape[1]]
        speckle = 110.0 + 60.0 * np.sin(rows / 3.0) * np.sin(columns / 3.7)
        _TEXTURES[shape] = (speckle + rng.normal(0.0, 2.0, speckle.shape)).clip(0, 255).astype(np.uint8)
    return _TEXTURES[shape]


def image(number, shape):
    start = number % 16
    made = texture(shape)[start : start + shape[0]].copy()
    made[0, :8] = np.frombuffer(np.int64(number).tobytes(), np.uint8)
    return made


def record(number, shape, *, first_id=1000):
    return FrameRecord(
        camera="primary",
        phase="inflation",
        data=image(number, shape),
        frame_id=first_id + number,
        camera_time_ns=number * 1_000_000,
        host_time_ns=number * 1_000_000 + 5_000,
        time_s=number / 11.0,
    )


def camera(shape):
    return {"primary": CameraMeta(width_px=shape[1], height_px=shape[0])}
