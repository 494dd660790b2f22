"""Read back what describes a run as a whole."""

from __future__ import annotations

import math

import h5py
import hdf5plugin  # noqa: F401  # HDF5 reads compressed runs by it

from bscd.acquisition.layout import AXIS_UNIT, INSTRUMENT, PRESSURE
from bscd.acquisition.names import AXES, CAMERAS, AxisUnit
from bscd.acquisition.records import AxisMeta, CameraMeta, PressureMeta, RunHeader
from bscd.hdf5 import ENTRY, dataset_at, group_at, read_identity, text_at
from drivers.interfaces import Range


def read_header(file: h5py.File) -> RunHeader:
    """The header that `bscd.acquisition.skeleton.create_skeleton` wrote; `KeyError` where a part is missing."""
    instrument, identity = group_at(file, INSTRUMENT), read_identity(file)
    return RunHeader(
        title=identity.title,
        cameras={name: _camera(group_at(instrument, name)) for name in CAMERAS if name in instrument},
        config_text=text_at(file, f"{ENTRY}/configuration/data"),
        recipe_text=text_at(file, f"{ENTRY}/recipe/data"),
        axes={name: _axis(group_at(instrument, name), AXIS_UNIT[name]) for name in AXES if name in instrument},
        pressure=_pressure(group_at(file, PRESSURE)) if PRESSURE in file else None,
        uuid=identity.uuid,
        start_time=identity.start_time,
        program_version=identity.program_version,
    )


def _number(node: h5py.Group, name: str) -> float:
    return float(dataset_at(node, name)[()]) if name in node else math.nan


def _limits(node: h5py.Group, low: str, high: str) -> Range | None:
    return Range(_number(node, low), _number(node, high)) if low in node else None


def _maker(node: h5py.Group) -> dict[str, str]:
    made = group_at(node, "fabrication")
    return {
        "vendor": text_at(made, "vendor"),
        "model": text_at(made, "model"),
        "serial": text_at(made, "serial_number"),
    }


def _camera(detector: h5py.Group) -> CameraMeta:
    _, height_px, width_px = dataset_at(detector, "data").shape
    return CameraMeta(
        width_px=int(width_px),
        height_px=int(height_px),
        bit_depth=int(dataset_at(detector, "bit_depth_readout")[()]),
        pixel_size_mm=_number(detector, "x_pixel_size"),
        **_maker(detector),
    )


def _axis(positioner: h5py.Group, unit: AxisUnit) -> AxisMeta:
    return AxisMeta(
        unit=unit,
        origin=_number(positioner, "origin"),
        limits=_limits(positioner, "soft_limit_min", "soft_limit_max"),
        tolerance=_number(positioner, "tolerance"),
        **_maker(positioner),
    )


def _pressure(sensor: h5py.Group) -> PressureMeta:
    return PressureMeta(
        limits_kpa=_limits(sensor, "limit_min", "limit_max"), noise_kpa=_number(sensor, "noise"), **_maker(sensor)
    )
