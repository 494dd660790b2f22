"""Make every group and dataset of a run file before its first frame, as SWMR needs it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import h5py
import numpy as np

from bscd.acquisition.checksum import header_sha256
from bscd.acquisition.layout import (
    AXIS_UNIT,
    COLUMNS,
    DEFINITION,
    EVENT_BYTES,
    FORMAT_VERSION,
    PRESSURE,
    ROWS_PER_CHUNK,
)
from bscd.acquisition.nodes import dataset_at
from bscd.acquisition.records import AxisMeta, AxisName, CameraMeta, CameraName, PressureMeta, RunHeader, RunState
from drivers.interfaces import Range


def create_skeleton(file: h5py.File, header: RunHeader) -> None:
    """Lay out a new run file: all that is known at the start, and empty datasets for what will come."""
    file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": f"bscd {header.program_version}"})
    entry = _group(file, "entry", "NXentry")
    entry.attrs["default"] = "data"
    entry["title"] = header.title
    entry["definition"] = DEFINITION
    dataset_at(entry, "definition").attrs["version"] = FORMAT_VERSION
    entry["entry_identifier_uuid"] = header.uuid
    entry["program_name"] = "bscd"
    dataset_at(entry, "program_name").attrs["version"] = header.program_version
    entry["start_time"] = header.start_time
    _text_scalar(entry, "end_time", 32, header.start_time)
    _note(entry, "configuration", "rig.toml", header.config_text)
    _note(entry, "recipe", "recipe", header.recipe_text)
    _create_recording(entry, header_sha256(header))
    instrument = _group(entry, "instrument", "NXinstrument")
    instrument["name"] = "biprism single-camera stereo-DIC rig"
    for name, camera in header.cameras.items():
        _create_detector(instrument, name, camera)
    for name, axis in header.axes.items():
        _create_positioner(instrument, name, axis)
    if header.pressure is not None:
        _create_pressure(file, header.pressure)
    _create_default_plot(entry, header.cameras)


def _group(parent: h5py.Group, name: str, nx_class: str) -> h5py.Group:
    group = parent.create_group(name)
    group.attrs["NX_class"] = nx_class
    return group


def _text_scalar(parent: h5py.Group, name: str, size: int, value: str) -> h5py.Dataset:
    """A text of fixed size, which can still be written in SWMR mode."""
    dataset = parent.create_dataset(name, shape=(), dtype=h5py.string_dtype("utf-8", size))
    dataset[()] = value.encode()
    return dataset


def _growing(parent: h5py.Group, name: str, dtype: object, fill: object, unit: str = "", about: str = "") -> None:
    dataset = parent.create_dataset(
        name, shape=(0,), maxshape=(None,), chunks=(ROWS_PER_CHUNK,), dtype=dtype, fillvalue=fill
    )
    if unit:
        dataset.attrs["units"] = unit
    if about:
        dataset.attrs["long_name"] = about


def _number(parent: h5py.Group, name: str, value: float, unit: str) -> None:
    parent[name] = float(value)
    dataset_at(parent, name).attrs["units"] = unit


def _note(entry: h5py.Group, name: str, file_name: str, text: str) -> None:
    note = _group(entry, name, "NXnote")
    note["type"] = "text/plain"
    note["file_name"] = file_name
    note["data"] = text


def _create_recording(entry: h5py.Group, header_digest: str) -> None:
    recording = _group(entry, "recording", "NXcollection")
    recording["header_sha256"] = header_digest
    _text_scalar(recording, "state", 16, RunState.RECORDING.value)
    _text_scalar(recording, "reason", 512, "")
    _text_scalar(recording, "sha256", 64, "")
    _growing(recording, "event_time", "S32", b"")
    _growing(recording, "event_text", h5py.string_dtype("utf-8", EVENT_BYTES), b"")


def _fabrication(device: h5py.Group, vendor: str, model: str, serial: str) -> None:
    group = _group(device, "fabrication", "NXfabrication")
    group["vendor"], group["model"], group["serial_number"] = vendor, model, serial


def _limits(device: h5py.Group, low: str, high: str, limits: Range | None, unit: str) -> None:
    if limits is not None:
        _number(device, low, limits.low, unit)
        _number(device, high, limits.high, unit)


def _create_detector(instrument: h5py.Group, name: str, camera: CameraMeta) -> None:
    detector = _group(instrument, name, "NXdetector")
    detector["local_name"] = f"{name} camera"
    detector["description"] = f"{camera.vendor} {camera.model}".strip()
    detector["serial_number"] = camera.serial
    _fabrication(detector, camera.vendor, camera.model, camera.serial)
    detector["bit_depth_readout"] = np.int64(camera.bit_depth)
    if not math.isnan(camera.pixel_size_mm):
        _number(detector, "x_pixel_size", camera.pixel_size_mm, "mm")
        _number(detector, "y_pixel_size", camera.pixel_size_mm, "mm")
    shape = (camera.height_px, camera.width_px)
    data = detector.create_dataset(
        "data", shape=(0, *shape), maxshape=(None, *shape), chunks=(1, *shape), dtype=camera.dtype
    )
    data.attrs.update({"units": "counts", "interpretation": "image", "long_name": f"{name} camera"})
    for column in COLUMNS:
        _growing(detector, column.name, column.dtype, column.fill, column.unit, column.description)


def _create_positioner(instrument: h5py.Group, name: AxisName, axis: AxisMeta) -> None:
    if axis.unit != AXIS_UNIT[name]:
        raise ValueError(f"the {name} axis is recorded in {AXIS_UNIT[name]}, not in {axis.unit}")
    positioner = _group(instrument, name, "NXpositioner")
    positioner["name"] = name
    _fabrication(positioner, axis.vendor, axis.model, axis.serial)
    _limits(positioner, "soft_limit_min", "soft_limit_max", axis.limits, axis.unit)
    _number(positioner, "tolerance", axis.tolerance, axis.unit)
    _number(positioner, "origin", axis.origin, axis.unit)
    _growing(positioner, "value", "<f8", np.nan, axis.unit, "reading at each frame of the run")
    _growing(positioner, "target_value", "<f8", np.nan, axis.unit, "where it was sent, at each frame of the run")


def _create_pressure(file: h5py.File, pressure: PressureMeta) -> None:
    sensor = _group(file, PRESSURE, "NXsensor")
    sensor["name"], sensor["measurement"] = "pressure", "pressure"
    _fabrication(sensor, pressure.vendor, pressure.model, pressure.serial)
    _limits(sensor, "limit_min", "limit_max", pressure.limits_kpa, "kPa")
    _number(sensor, "noise", pressure.noise_kpa, "kPa")
    _growing(sensor, "value", "<f8", np.nan, "kPa", "at each frame of the run, interpolated in the log")
    log = _group(sensor, "value_log", "NXlog")
    _growing(log, "time", "<i8", 0, "ns", "the host's clock, as in host_time_ns of the frames")
    _growing(log, "value", "<f8", np.nan, "kPa", "gauge pressure as read")


def _create_default_plot(entry: h5py.Group, cameras: Mapping[CameraName, CameraMeta]) -> None:
    """The first camera's images over the frame's place in the run; links, so nothing is kept twice."""
    camera = next(iter(cameras))
    plot = _group(entry, "data", "NXdata")
    plot.attrs["signal"] = "data"
    plot.attrs["axes"] = ["sequence_number", ".", "."]
    plot["data"] = h5py.SoftLink(f"/entry/instrument/{camera}/data")
    plot["sequence_number"] = h5py.SoftLink(f"/entry/instrument/{camera}/sequence_number")
    plot["title"] = f"{camera} camera"
