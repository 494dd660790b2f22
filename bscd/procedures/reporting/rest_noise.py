"""Noise floors of an inflation from its frames at rest, and what they share with the reference."""

from __future__ import annotations

import math

import numpy as np

from bscd.analysis.report.measurement import RestNoise
from bscd.analysis.surface import NoiseFloor, noise_floor
from bscd.arrays import FloatArray
from bscd.errors import InputError
from bscd.procedures.measuring.frames import count_at_rest
from bscd.procedures.reporting.source import Source, known

#: More static frames make the floors no surer.
_MOST = 64


def rest_noise(source: Source) -> tuple[RestNoise | None, str]:
    """The noise floors, or None and why there are none.

    Frames at rest that the reference is not made of are taken where there are two or more: their displacements
    hold the reference's noise as every measured frame does. Otherwise it is the reference's own frames. These share
    its noise: of n frames with noise s each, the difference from their mean scatters by s sqrt(1 - 1/n), that of any
    other frame by s sqrt(1 + 1/n); the spatial deviations are multiplied by the ratio.
    """
    results = source.results
    reference = results.header.reference_frames
    numbers = results.frame_numbers()
    at_rest = numbers[: count_at_rest(results.array("pressure_kpa"))]
    others = at_rest[~np.isin(at_rest, reference)]
    if len(others) >= 2:
        taken, factor = others[:_MOST], 1.0
        basis = f"{len(taken)} frames at rest that the reference is not made of"
    elif len(reference) >= 2:
        taken, factor = np.array(reference), math.sqrt((len(reference) + 1.0) / (len(reference) - 1.0))
        basis = (
            f"the {len(reference)} frames that the reference is made of; as they share its noise, spatial values are "
            f"multiplied by {factor:.2f}"
        )
    else:
        return None, "fewer than two frames at rest; record some before the ramp"
    frames = [results.frame(int(np.flatnonzero(numbers == number)[0])) for number in taken]
    moved = np.stack([known(one.uvw_mm, one.valid) for one in frames])
    strained = np.stack([known(np.asarray(one.strain, float), one.valid) for one in frames])
    try:
        floor = noise_floor(moved)
    except InputError as error:
        return None, str(error)
    strain = _strain_floor(strained)
    return (
        RestNoise(
            basis=basis,
            frames=len(taken),
            displacement_mm=factor * floor.spatial_std,
            temporal_mm=floor.std,
            strain=None if strain is None else factor * strain.spatial_std,
            temporal_strain=None if strain is None else strain.std,
            floor=floor,
        ),
        "",
    )


def _strain_floor(strain: FloatArray) -> NoiseFloor | None:
    try:
        return noise_floor(strain)
    except InputError:
        return None
