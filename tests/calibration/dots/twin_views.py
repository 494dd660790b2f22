"""Images of the twin's cube in chosen states, with the truth of their dots."""

from __future__ import annotations

import numpy as np

from bscd.calibration.dots import SplitLine
from bscd.calibration.target import GridTarget
from drivers.twin.options import CubeOptions, LightOptions, PrismOptions, RestOptions, SensorOptions, TwinOptions
from drivers.twin.trace import trace_pixels
from drivers.twin.world import World

RAISED, LOWERED = 70.0, 5.0
FACE_DEG, CORNER_DEG = 0.0, 45.0


def twin(
    rotation_deg=CORNER_DEG, jack_mm=LOWERED, translation_mm=50.0, shift_mm=(0, 0, 0), turn_deg=(0, 0, 0), **parts
):
    options = TwinOptions(
        rest=RestOptions(rotation_deg=rotation_deg, jack_mm=jack_mm, translation_mm=translation_mm),
        sensor=SensorOptions(noise="gaussian", bits=parts.get("bits", 8)),
        cube=CubeOptions(**parts.get("cube", {})),
        light=LightOptions(**parts.get("light", {})),
        prism=PrismOptions(**parts.get("prism", {})),
    )
    world = World(options)
    world.place("cube", shift_mm=tuple(shift_mm), turn_deg=tuple(turn_deg))
    return world


def expose(world, camera="primary", brightness=1.0):
    exposure_s = world.options.sensor.nominal_exposure_s * brightness
    return world.expose(camera, exposure_s=exposure_s, gain_db=0.0, rng=np.random.default_rng(1))


def target_of(world):
    cube = world.options.cube
    return GridTarget(cube.columns, cube.rows, cube.pitch_mm, cube.dot_diameter_mm, cube.margin_mm)


def truth(world, camera="primary", side=0):
    return next(view for view in world.dots(camera) if view.side == side)


def errors(finding, dots):
    """``(N, 2)`` px of the found dots against the truth of the same labels."""
    place = {int(k): xy for k, xy in zip(dots.index, dots.xy_px, strict=True)}
    return np.array([xy - place[int(k)] for k, xy in zip(finding.index, finding.xy_px, strict=True)])


def true_split(world):
    """The line where the trace changes from one roof face to the other, by bisection in each row."""
    optics = world.optics("primary")
    rows = np.linspace(0, optics.height_px - 1, 33)
    low, high = np.full_like(rows, 0.3 * optics.width_px), np.full_like(rows, 0.7 * optics.width_px)

    def side(columns):
        return trace_pixels(optics, world.prism(), np.stack([columns, rows], axis=-1)).side

    start = side(low)
    assert (side(high) != start).all()
    for _ in range(40):
        middle = (low + high) / 2
        same = side(middle) == start
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    middle_row = (optics.height_px - 1) / 2
    tilt, column = np.polyfit(rows - middle_row, low, 1)
    return SplitLine(float(column), float(tilt), True, 0.01, middle_row)


def side_of(world, half):
    """Which roof face fills the left or right half of the image."""
    column = 100.0 if half == "left" else world.optics("primary").width_px - 100.0
    return int(trace_pixels(world.optics("primary"), world.prism(), np.array([[column, 500.0]])).side[0])


def polygon_centroid(rim_px):
    """Area centroid ``(N, 2)`` of polygons ``(N, M, 2)``."""
    x, y = rim_px[..., 0], rim_px[..., 1]
    u, v = np.roll(x, -1, axis=-1), np.roll(y, -1, axis=-1)
    cross = x * v - u * y
    area = 3.0 * cross.sum(-1)
    return np.stack([((x + u) * cross).sum(-1) / area, ((y + v) * cross).sum(-1) / area], axis=-1)
