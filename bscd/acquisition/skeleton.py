"""Make every group and dataset of a run file before its first frame, as SWMR needs it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import h5py
import hdf5plugin
import numpy as np

from bscd.acquisition.account_columns import create_account
from bscd.acquisition.checksum import header_sha256
from bscd.acquisition.layout import AXIS_UNIT, COLUMNS, EVENT_BYTES, PRESSURE, RUN_FILE
from bscd.acquisition.names import AxisName, CameraName, Compression
from bscd.acquisition.records import AxisMeta, CameraMeta, PressureMeta, RunHeader
from bscd.hdf5 import RECORDING, FileIdentity, group_at, make_column, make_entry, make_group, make_note, make_number
from drivers.interfaces import Range


def create_skeleton(file: h5py.File, header: RunHeader, compression: Compression = "none") -> None:
    """Lay out a new run file: all that is known at the start, and empty datasets for what will come."""
    identity = FileIdentity(header.title, header.uuid, header.start_time, header.program_version)
    entry = make_entry(file, RUN_FILE, identity, header_sha256(header))
    recording = group_at(file, RECORDING)
    create_account(recording)
    make_column(recording, "event_time", "S32", b"")
    make_column(recording, "event_text", h5py.string_dtype("utf-8", EVENT_BYTES), b"")
    make_note(entry, "configuration", "rig.toml", header.config_text)
    make_note(entry, "recipe", "recipe", header.recipe_text)
    instrument = make_group(entry, "instrument", "NXinstrument")
    instrument["name"] = "biprism single-camera stereo-DIC rig"
    for name, camera in header.cameras.items():
        _create_detector(instrument, name, camera, compression)
    for name, axis in header.axes.items():
        _create_positioner(instrument, name, axis)
    if header.pressure is not None:
        _create_pressure(file, header.pressure)
    _create_default_plot(entry, header.cameras)


def _fabrication(device: h5py.Group, vendor: str, model: str, serial: str) -> None:
    group = make_group(device, "fabrication", "NXfabrication")
    group["vendor"], group["model"], group["serial_number"] = vendor, model, serial


def _limits(device: h5py.Group, low: str, high: str, limits: Range | None, unit: str) -> None:
    if limits is not None:
        make_number(device, low, limits.low, unit)
        make_number(device, high, limits.high, unit)


def _create_detector(instrument: h5py.Group, name: str, camera: CameraMeta, compression: Compression) -> None:
    detector = make_group(instrument, name, "NXdetector")
    detector["local_name"] = f"{name} camera"
    detector["description"] = f"{camera.vendor} {camera.model}".strip()
    detector["serial_number"] = camera.serial
    _fabrication(detector, camera.vendor, camera.model, camera.serial)
    detector["bit_depth_readout"] = np.int64(camera.bit_depth)
    if not math.isnan(camera.pixel_size_mm):
        make_number(detector, "x_pixel_size", camera.pixel_size_mm, "mm")
        make_number(detector, "y_pixel_size", camera.pixel_size_mm, "mm")
    shape = (camera.height_px, camera.width_px)
    data = detector.create_dataset(
        "data",
        shape=(0, *shape),
        maxshape=(None, *shape),
        chunks=(1, *shape),
        dtype=camera.dtype,
        **(hdf5plugin.Bitshuffle(cname="lz4") if compression == "bitshuffle-lz4" else {}),
    )
    data.attrs.update({"units": "counts", "interpretation": "image", "long_name": f"{name} camera"})
    for column in COLUMNS:
        make_column(detector, column.name, column.dtype, column.fill, column.unit, column.description)


def _create_positioner(instrument: h5py.Group, name: AxisName, axis: AxisMeta) -> None:
    if axis.unit != AXIS_UNIT[name]:
        raise ValueError(f"the {name} axis is recorded in {AXIS_UNIT[name]}, not in {axis.unit}")
    positioner = make_group(instrument, name, "NXpositioner")
    positioner["name"] = name
    _fabrication(positioner, axis.vendor, axis.model, axis.serial)
    _limits(positioner, "soft_limit_min", "soft_limit_max", axis.limits, axis.unit)
    make_number(positioner, "tolerance", axis.tolerance, axis.unit)
    make_number(positioner, "origin", axis.origin, axis.unit)
    make_column(positioner, "value", "<f8", np.nan, axis.unit, "reading at each frame of the run")
    make_column(positioner, "target_value", "<f8", np.nan, axis.unit, "where it was sent, at each frame of the run")


def _create_pressure(file: h5py.File, pressure: PressureMeta) -> None:
    sensor = make_group(file, PRESSURE, "NXsensor")
    sensor["name"], sensor["measurement"] = "pressure", "pressure"
    _fabrication(sensor, pressure.vendor, pressure.model, pressure.serial)
    _limits(sensor, "limit_min", "limit_max", pressure.limits_kpa, "kPa")
    make_number(sensor, "noise", pressure.noise_kpa, "kPa")
    make_column(sensor, "value", "<f8", np.nan, "kPa", "at each frame of the run, interpolated in the log")
    log = make_group(sensor, "value_log", "NXlog")
    make_column(log, "time", "<i8", 0, "ns", "the host's clock, as in host_time_ns of the frames")
    make_column(log, "value", "<f8", np.nan, "kPa", "gauge pressure as read")


def _create_default_plot(entry: h5py.Group, cameras: Mapping[CameraName, CameraMeta]) -> None:
    """The first camera's images over the frame's place in the run; links, so nothing is kept twice."""
    camera = next(iter(cameras))
    plot = make_group(entry, "data", "NXdata")
    plot.attrs["signal"] = "data"
    plot.attrs["axes"] = ["sequence_number", ".", "."]
    plot["data"] = h5py.SoftLink(f"/entry/instrument/{camera}/data")
    plot["sequence_number"] = h5py.SoftLink(f"/entry/instrument/{camera}/sequence_number")
    plot["title"] = f"{camera} camera"
