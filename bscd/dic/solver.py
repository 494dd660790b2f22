"""Solve points by IC-GN from their initial guesses: the kernel, over threads."""

from __future__ import annotations

import ctypes
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import FloatArray, IntArray
from bscd.dic.correlation import Status
from bscd.dic.images import PreparedImage
from bscd.dic.library import FOUND_COLUMNS, ImageStruct, InstructionSet, OptionsStruct, library
from bscd.dic.spline import noise_energy, taps

ShapeName = Literal["translation", "affine", "curved", "quadratic"]

Lighting = Literal["uniform", "linear"]
"""How brightness may change over a subset: by a gain and an offset, or by a gain that is linear across it as well."""

LIGHTINGS: tuple[Lighting, ...] = ("uniform", "linear")

PARAMETERS: dict[ShapeName, int] = {"translation": 6, "affine": 6, "curved": 12, "quadratic": 12}
"""Parameters of the shape functions; those of u first, then those of v."""

SOLVED: dict[ShapeName, int] = {"translation": 2, "affine": 6, "curved": 6, "quadratic": 12}
"""Those of them that are solved for; a translation's gradients and the second derivatives of "curved" are held."""

#: Points that a thread takes at a time; results do not depend on it.
_CHUNK = 512


@dataclass(frozen=True)
class SolverOptions:
    """How points are solved.

    ``subset_px`` is odd. A point converges when the last step moved its subset by less than ``tolerance_px`` (norm of
    the displacement at the subset's edge) and diverges when it leaves its guess by more than ``reach_px``. A subset
    counts with at least ``least_share`` of its pixels. ``noise_grey`` is the reference's noise. ``sigma_max_px`` bounds
    the displacement's sigma that the noise (of both images together, ``noise_both_grey``) lets expect.
    """

    subset_px: int = 21
    shape: ShapeName = "affine"
    lighting: Lighting = "uniform"
    max_iterations: int = 30
    tolerance_px: float = 0.001
    reach_px: float = 8.0
    least_share: float = 0.2
    zncc_min: float = 0.7
    noise_grey: float = 0.0
    noise_both_grey: float = 1.0
    sigma_max_px: float = 0.5


@dataclass(frozen=True)
class Solved:
    """The kernel's own answer for N points.

    ``shape`` ``(N, P)``, ``found`` ``(N, 8)`` (`FOUND_COLUMNS`), ``status`` and ``iterations`` ``(N,)`` int32.
    """

    shape: FloatArray
    found: FloatArray
    status: NDArray[np.int32]
    iterations: NDArray[np.int32]

    def column(self, name: str) -> FloatArray:
        """A column ``(N,)`` of what was found."""
        return self.found[:, FOUND_COLUMNS.index(name)]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which points converged to a match that can be believed."""
        return self.status == Status.VALID


@dataclass(frozen=True, eq=False)
class KnownSubsets:
    """What the kernel found of a reference's subsets, for later calls with the same points and options.

    ``memory`` ``(M, K)`` a row a point, 0 where nothing was found yet; ``rows`` ``(N,)`` those of some points.
    """

    memory: FloatArray
    rows: IntArray

    @classmethod
    def none_of(cls, count: int, shape: ShapeName) -> KnownSubsets:
        """Of ``count`` points, nothing yet."""
        return cls(np.zeros((count, library().bscd_memory_row(SOLVED[shape]))), np.arange(count))

    def only(self, which: IntArray) -> KnownSubsets:
        """Of some of the points, in the same memory."""
        return KnownSubsets(self.memory, self.rows[which])


def solve(
    reference: PreparedImage,
    current: PreparedImage,
    points_px: FloatArray,
    shape: FloatArray,
    options: SolverOptions,
    *,
    threads: int | None = None,
    instructions: InstructionSet = InstructionSet.BEST,
    known_subsets: KnownSubsets | None = None,
) -> Solved:
    """Solve points ``(N, 2)`` (column, row) from the shape parameters ``(N, P)`` of their guesses.

    ``known_subsets`` belong to these points; they save time and change no result.

    ``threads`` None takes all cores that the process may use; the GIL is released. Results do not depend on it.
    """
    count = len(points_px)
    points = np.ascontiguousarray(points_px, np.float64)
    result = np.array(shape, np.float64, order="C")
    found = np.full((count, len(FOUND_COLUMNS)), np.nan)
    status = np.zeros(count, np.int32)
    iterations = np.zeros(count, np.int32)
    known = np.isfinite(result).all(axis=1)
    status[~known] = Status.NO_GUESS
    images = (_image_struct(reference), _image_struct(current))
    settings = _options_struct(options, reference)
    run = library().bscd_icgn
    memory, rows = None, np.zeros(0, np.int64)
    if known_subsets is not None:
        memory, rows = known_subsets.memory.ctypes.data, np.ascontiguousarray(known_subsets.rows, np.int64)

    if not known.all():
        some = np.flatnonzero(known)
        part = solve(
            reference,
            current,
            points[some],
            result[some],
            options,
            threads=threads,
            instructions=instructions,
            known_subsets=None if known_subsets is None else known_subsets.only(some),
        )
        result[some], found[some], status[some] = part.shape, part.found, part.status
        iterations[some] = part.iterations
        return Solved(result, found, status, iterations)

    def work(first: int) -> None:
        last = min(first + _CHUNK, count)
        addresses = (array[first:last].ctypes.data for array in (points, result, found, status, iterations))
        failed = run(
            int(instructions),
            ctypes.byref(images[0]),
            ctypes.byref(images[1]),
            ctypes.byref(settings),
            last - first,
            *addresses,
            memory,
            rows[first:last].ctypes.data,
        )
        if failed == 1:
            raise MemoryError("the correlator's kernel got no memory for its subset")
        if failed:
            raise RuntimeError(f"this machine can not run the kernel for {instructions.name}")

    starts = range(0, count, _CHUNK)
    workers = min(threads or usable_cores(), len(starts))
    if workers <= 1:
        for first in starts:
            work(first)
    else:
        with ThreadPoolExecutor(workers, thread_name_prefix="icgn") as pool:
            for _ in pool.map(work, starts):
                pass
    return Solved(result, found, status, iterations)


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def with_noise(options: SolverOptions, reference_grey: float, current_grey: float) -> SolverOptions:
    """The options for the noise of two images, grey levels."""
    return replace(options, noise_grey=reference_grey, noise_both_grey=float(np.hypot(reference_grey, current_grey)))


def _image_struct(image: PreparedImage) -> ImageStruct:
    height, width = image.shape
    return ImageStruct(
        coefficients=image.coefficients.ctypes.data,
        mask=None if image.mask is None else image.mask.ctypes.data,
        stride=image.coefficients.shape[1],
        width=width,
        height=height,
        pad=image.pad_px,
        taps=taps(image.spline),
    )


def _options_struct(options: SolverOptions, reference: PreparedImage) -> OptionsStruct:
    energy = noise_energy(reference.spline)
    parameters = PARAMETERS[options.shape]
    return OptionsStruct(
        radius=options.subset_px // 2,
        parameters=parameters,
        solved=SOLVED[options.shape],
        lit=options.lighting == "linear",
        max_iterations=options.max_iterations,
        min_pixels=max(int(np.ceil(options.least_share * options.subset_px**2)), parameters + 3),
        tolerance_px=options.tolerance_px,
        reach_px=options.reach_px,
        zncc_min=options.zncc_min,
        noise_variance=options.noise_grey**2,
        value_energy=energy.value,
        derivative_energy=energy.derivative,
        variance_max=(options.sigma_max_px / max(options.noise_both_grey, 1e-3)) ** 2,
    )
