"""Small frames with known content, made from a seed."""

from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np

from bscd.acquisition import AxisMeta, CameraMeta, FrameRecord, PressureMeta
from drivers.interfaces import FrameStatus, Range

CAMERAS = {
    "primary": CameraMeta(
        width_px=12, height_px=8, bit_depth=8, pixel_size_mm=0.0067, vendor="Maker", model="M1", serial="0001"
    ),
    "auxiliary": CameraMeta(width_px=10, height_px=6, bit_depth=12, serial="0002"),
}
AXES = {
    "translation": AxisMeta("mm", origin=50.0, limits=Range(0, 100), tolerance=0.0025, serial="T"),
    "rotation": AxisMeta("deg", limits=Range(-180.0, 180.0), tolerance=0.01),
    "jack": AxisMeta("mm", limits=Range(0.0, 84.0)),
}
PRESSURE = PressureMeta(limits_kpa=Range(0.05, 16.0), noise_kpa=0.01, model="P")
START = datetime(2026, 3, 1, 12, 0, 0, tzinfo=UTC)
SETTINGS = {
    "title": "Scan of the cube, 17 Positionen, été",
    "config_text": '[target]\npitch_mm = 2.0 # "µ"\n',
    "recipe_text": '{"kind": "bsc"}',
    "cameras": CAMERAS,
    "axes": AXES,
    "now": lambda: START,
}


def frames(count: int, seed: int = 1) -> Iterator[FrameRecord]:
    """Alternating frames of both cameras, two repeats a position, every field with a value of its own."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        primary = number % 2 == 0
        meta = CAMERAS["primary" if primary else "auxiliary"]
        size = (meta.height_px, meta.width_px)
        yield FrameRecord(
            camera="primary" if primary else "auxiliary",
            phase="reference-face",
            data=rng.integers(0, 2**meta.bit_depth, size).astype(meta.dtype),
            frame_id=100 + number // 2,
            camera_time_ns=1_700_000_000_123_456_789 + number,
            host_time_ns=1_700_000_001_987_654_321 + number,
            status=FrameStatus.OK,
            target_position=number // 4 - 1,
            y_mm=float(rng.normal()),
            rotation_deg=float(rng.normal()),
            jack_mm=5.0,
            pressure_kpa=float(rng.normal()),
            exposure_s=0.01,
            gain_db=3.0,
            time_s=number / 11,
        )


def same(one: FrameRecord, other: FrameRecord) -> bool:
    """Whether two frames are the same bit for bit; NaN equals NaN."""
    for name in FrameRecord.__slots__:
        a, b = getattr(one, name), getattr(other, name)
        if name == "data":
            if a.dtype != b.dtype or not np.array_equal(a, b):
                return False
        elif a != b and not (isinstance(a, float) and isinstance(b, float) and np.isnan(a) and np.isnan(b)):
            return False
    return True
