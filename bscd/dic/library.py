"""The compiled kernel: found, loaded and declared once (bscd/dic/kernel/icgn.h)."""

from __future__ import annotations

import ctypes
from enum import IntEnum
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path


class InstructionSet(IntEnum):
    """Which of the kernel's builds runs."""

    BEST = -1
    BASELINE = 0
    AVX2 = 1
    AVX512 = 2
    WIDE = 3
    """The AVX-512 source on any machine: for tests."""


class ImageStruct(ctypes.Structure):
    """``bscd_image``."""

    _fields_ = (
        ("coefficients", ctypes.c_void_p),
        ("mask", ctypes.c_void_p),
        ("stride", ctypes.c_int64),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("pad", ctypes.c_int32),
        ("taps", ctypes.c_int32),
    )


class OptionsStruct(ctypes.Structure):
    """``bscd_options``."""

    _fields_ = (
        ("radius", ctypes.c_int32),
        ("parameters", ctypes.c_int32),
        ("solved", ctypes.c_int32),
        ("lit", ctypes.c_int32),
        ("max_iterations", ctypes.c_int32),
        ("min_pixels", ctypes.c_int32),
        ("tolerance_px", ctypes.c_double),
        ("reach_px", ctypes.c_double),
        ("zncc_min", ctypes.c_double),
        ("noise_variance", ctypes.c_double),
        ("value_energy", ctypes.c_double * 2),
        ("derivative_energy", ctypes.c_double * 2),
        ("variance_max", ctypes.c_double),
    )


FOUND_COLUMNS = ("zncc", "norm_px", "var_u", "cov_uv", "var_v", "residual_variance", "gain", "pixels")
"""What a row of ``found`` holds, in the kernel's order."""


@cache
def library() -> ctypes.CDLL:
    """The kernel. Raises `RuntimeError` when it was not built with the package."""
    folder = Path(__file__).parent
    for suffix in EXTENSION_SUFFIXES:
        built = folder / f"_icgn{suffix}"
        if built.exists():
            return _declared(ctypes.CDLL(str(built)))
    raise RuntimeError(f"the correlator's kernel is not built in {folder}; install the package again: pip install .")


def best_set() -> InstructionSet:
    """The best instruction set of this machine."""
    return InstructionSet(library().bscd_best_set())


def can_run(chosen: InstructionSet) -> bool:
    """Whether this machine can run the kernel for that set."""
    return chosen is InstructionSet.BEST or bool(library().bscd_can_run(int(chosen)))


def _declared(loaded: ctypes.CDLL) -> ctypes.CDLL:
    pointer = ctypes.c_void_p
    loaded.bscd_best_set.restype = ctypes.c_int
    loaded.bscd_best_set.argtypes = ()
    loaded.bscd_can_run.restype = ctypes.c_int
    loaded.bscd_can_run.argtypes = (ctypes.c_int,)
    loaded.bscd_memory_row.restype = ctypes.c_int
    loaded.bscd_memory_row.argtypes = (ctypes.c_int,)
    loaded.bscd_icgn.restype = ctypes.c_int
    loaded.bscd_icgn.argtypes = (
        ctypes.c_int,
        ctypes.POINTER(ImageStruct),
        ctypes.POINTER(ImageStruct),
        ctypes.POINTER(OptionsStruct),
        ctypes.c_int64,
        *(pointer,) * 7,
    )
    return loaded
