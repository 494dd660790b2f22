"""The illumination: two lamps and a diffuse part, smooth over every surface."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drivers.twin.options import LightOptions


def pack_light(light: LightOptions) -> tuple[float, ...]:
    """The light's 13 numbers for `brightness`: level, ambient, two directions, norm, gradient, background."""
    up = math.radians(light.lamp_elevation_deg)
    lamps = [
        (math.sin(a) * math.cos(up), -math.cos(a) * math.cos(up), math.sin(up))
        for a in np.radians(light.lamp_azimuth_deg)
    ]
    facing = sum(max(0.0, -lamp[1]) for lamp in lamps)
    head = (light.level, light.ambient, *lamps[0], *lamps[1], max(facing, 1e-6))
    return (*head, *light.gradient_per_mm, light.background)


@njit(inline="always")
def brightness(x, y, z, nx, ny, nz, light):
    """Brightness of white paper at a world point (mm) with outward unit normal n: Lambert's law for both lamps."""
    first = nx * light[2] + ny * light[3] + nz * light[4]
    second = nx * light[5] + ny * light[6] + nz * light[7]
    lamps = (max(first, 0.0) + max(second, 0.0)) / light[8]
    gradient = 1.0 + x * light[9] + y * light[10] + z * light[11]
    return light[0] * (light[1] + (1.0 - light[1]) * lamps) * max(gradient, 0.0)
