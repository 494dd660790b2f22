"""Make every group and dataset of a results file before its first frame, as SWMR needs it."""

from __future__ import annotations

import h5py
import numpy as np

from bscd.hdf5 import FileIdentity, describe, make_column, make_entry, make_group, make_text
from bscd.results.checksum import header_sha256
from bscd.results.layout import COLUMNS, COMMIT_COLUMN, FRAME_SHA256, QUANTITIES, RESULTS_FILE, Quantity
from bscd.results.records import VALID, MembraneFrame, Origin, ParameterValue, ResultsHeader


def check_header(header: ResultsHeader) -> None:
    """Raise `ValueError` for a header that no file can keep."""
    points_px = np.asarray(header.points_px)
    if points_px.ndim != 2 or points_px.shape[1] != 2 or len(points_px) == 0:
        raise ValueError(f"points_px is {points_px.shape}, not (N, 2) with a point at least")
    if VALID not in header.status_names or not all(0 <= code < 255 for code in header.status_names):
        raise ValueError(f"status codes are 0 to 254 and {VALID} is among them, not {sorted(header.status_names)}")
    for name, value in header.parameters.items():
        if not isinstance(value, ParameterValue) or name in ("", "NX_class"):
            raise ValueError(f"parameter {name!r} is {value!r}, not a number or a text")
    membrane = header.membrane
    if membrane is not None and (np.shape(membrane.origin_mm), np.shape(membrane.axes)) != ((3,), (3, 3)):
        raise ValueError("a membrane frame is an origin (3,) and axes (3, 3)")


def create_skeleton(file: h5py.File, header: ResultsHeader) -> None:
    """Lay out a new results file: all that is known at the start, and empty datasets for the frames."""
    identity = FileIdentity(header.title, header.uuid, header.start_time, header.program_version)
    entry = make_entry(file, RESULTS_FILE, identity, header_sha256(header))
    _make_measurement(entry, header)
    _make_process(entry, header)
    _make_data(entry, header)
    make_column(file, FRAME_SHA256, "S64", b"", about="checksum of the frame's numbers")


def _make_measurement(entry: h5py.Group, header: ResultsHeader) -> None:
    measurement = make_group(entry, "measurement", "NXcollection")
    measurement["stereo"] = header.stereo
    measurement["reference_frames"] = np.array(header.reference_frames, "<i8")
    for name, origin in (("run", header.run), ("calibration", header.calibration)):
        _make_origin(measurement, name, origin)
    if header.membrane is not None:
        _make_membrane(measurement, header.membrane)


def _make_origin(measurement: h5py.Group, name: str, origin: Origin) -> None:
    group = make_group(measurement, name, "NXcollection")
    group["file_name"] = origin.file_name
    make_text(group, "uuid", 64, origin.uuid)
    make_text(group, "sha256", 64, origin.checksum)


def _make_membrane(measurement: h5py.Group, membrane: MembraneFrame) -> None:
    group = make_group(measurement, "membrane_frame", "NXcollection")
    origin = group.create_dataset("origin_mm", data=np.asarray(membrane.origin_mm, "<f8"))
    describe(origin, "mm", "origin of the membrane frame in the world frame")
    axes = group.create_dataset("axes", data=np.asarray(membrane.axes, "<f8"))
    describe(axes, "", "x', y', z' in the world frame, a row each")


def _make_process(entry: h5py.Group, header: ResultsHeader) -> None:
    process = make_group(entry, "process", "NXprocess")
    process["program"], process["version"] = "bscd", header.program_version
    process["date"] = header.start_time
    parameters = make_group(process, "parameters", "NXparameters")
    parameters["json"] = header.parameters_json()
    for name, value in header.parameters.items():
        parameters.attrs[name] = value


def _make_data(entry: h5py.Group, header: ResultsHeader) -> None:
    """The default plot is the largest displacement over the frames; all else stands beside it."""
    data = make_group(entry, "data", "NXdata")
    data.attrs.update({"signal": "displacement_max_mm", "axes": [COMMIT_COLUMN]})
    data["title"] = header.title
    points = data.create_dataset("points_px", data=np.asarray(header.points_px, "<f8"))
    describe(points, "px", "column, row of each requested point in the reference frame's left view")
    for name, dtype, fill, unit, about in COLUMNS:
        make_column(data, name, dtype, fill, unit, about)
    for axis in (COMMIT_COLUMN, "time_s", "pressure_kpa"):
        data.attrs[f"{axis}_indices"] = 0
    for quantity in QUANTITIES:
        _make_quantity(data, quantity, len(header.points_px))
    codes = sorted(header.status_names)
    data["status"].attrs.update(
        {"codes": np.array(codes, np.uint8), "code_names": [header.status_names[code] for code in codes]}
    )


def _make_quantity(data: h5py.Group, quantity: Quantity, points: int) -> None:
    shape = (points, *quantity.shape)
    dataset = data.create_dataset(
        quantity.name,
        shape=(0, *shape),
        maxshape=(None, *shape),
        chunks=(1, *shape),
        dtype=quantity.dtype,
        fillvalue=quantity.fill,
    )
    describe(dataset, quantity.unit, quantity.description)
