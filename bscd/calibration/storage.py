"""Calibration files: HDF5, everything that made the calibration and everything that follows from it."""

from __future__ import annotations

import hashlib
import os
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bscd.calibration.calibration import Calibration, ControlPoints
from bscd.calibration.choices import CalibrationChoices
from bscd.calibration.dlt import DltCamera
from bscd.calibration.lens import LensCamera
from bscd.calibration.maps import LinearMap, SmoothMap
from bscd.calibration.motion import TargetMotion
from bscd.calibration.shifts import SHIFT_NAMES
from bscd.errors import InputError

FORMAT = "bscd-calibration"
FORMAT_VERSION = 3


def calibration_checksum(calibration: Calibration) -> str:
    """SHA-256 over the numbers and choices that determine every reconstruction, and the images that they are for."""
    digest = hashlib.sha256()
    for camera in (calibration.left, calibration.right):
        digest.update(camera.coefficients.tobytes())
    for entry in fields(ControlPoints):
        digest.update(getattr(calibration.control, entry.name).tobytes())
    digest.update(repr(sorted(asdict(calibration.choices).items())).encode())
    digest.update(repr(sorted(calibration.image_size_px.items())).encode())
    return digest.hexdigest()


def save_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write a calibration to a new file, whole or not at all.

    Raises
    ------
    InputError
        The file exists already.
    """
    path = Path(path)
    if path.exists():
        raise InputError(f"{path}: exists already; calibrations are never overwritten, choose another name")
    unfinished = path.with_name(path.name + ".part")
    try:
        with h5py.File(unfinished, "w") as file:
            _write(calibration, file)
        os.link(unfinished, path)  # fails if somebody else made it meanwhile
    finally:
        unfinished.unlink(missing_ok=True)


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    InputError
        No such file, or not a calibration.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such calibration file; make one with `bscd calibrate`")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise InputError(f"{path}: not a calibration file; make one with `bscd calibrate`")
            if file.attrs["format_version"] != FORMAT_VERSION:
                raise InputError(f"{path}: written by another version of bscd; calibrate again from the run files")
            calibration = _read(file)
            stored = file.attrs["checksum"]
    except (OSError, KeyError) as err:
        raise InputError(f"{path}: damaged or not a calibration file ({err}); calibrate again") from err
    if stored != calibration_checksum(calibration):
        raise InputError(f"{path}: its numbers do not match its checksum; calibrate again from the run files")
    return calibration


def _write(calibration: Calibration, file: h5py.File) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["format_version"] = FORMAT_VERSION
    file.attrs["checksum"] = calibration_checksum(calibration)
    for name in ("sigma_px", "epipolar_limit_px", "jack_mm"):
        file.attrs[name] = getattr(calibration, name)
    for name, value in asdict(calibration.choices).items():
        file.attrs[f"choice_{name}"] = value
    cameras = file.create_group("cameras")
    for name, camera in {"left": calibration.left, "right": calibration.right, **calibration.reference}.items():
        group = cameras.create_group(name)
        group["dlt"] = camera.coefficients
        group["dlt_covariance"] = camera.covariance
        group["matrix"] = camera.matrix
        group.attrs["rms_px"] = camera.rms_px
    sizes = file.create_group("image_size_px")
    for name, size_px in calibration.image_size_px.items():
        sizes[name] = np.array(size_px, np.int64)
    lenses = file.create_group("lenses")
    for name, lens in calibration.lenses.items():
        lenses[name] = lens.parameters
    motion = file.create_group("motion")
    for name, value in asdict(calibration.motion).items():
        motion[name] = value
    control = file.create_group("control_points")
    for entry in fields(ControlPoints):
        control[entry.name] = getattr(calibration.control, entry.name)
    control["shifts_px"] = calibration.shifts_px
    control["shifts_px"].attrs["columns"] = SHIFT_NAMES
    _write_maps(calibration, file.create_group("maps"))
    file["hull_equations"] = calibration.hull.equations
    file.create_group("figures").attrs.update(calibration.figures)
    file.create_group("origins").attrs.update(calibration.origins)


def _write_maps(calibration: Calibration, group: h5py.Group) -> None:
    """For other readers; loading recomputes the maps from the control points."""
    maps = calibration.maps
    smooth = maps.beyond if isinstance(maps, LinearMap) else maps
    for entry in fields(SmoothMap):
        group[f"smooth_{entry.name}"] = getattr(smooth, entry.name)
    if isinstance(maps, LinearMap):
        group["linear_simplices"] = maps.tessellation.simplices


def _array(group: h5py.Group, name: str) -> NDArray[Any]:
    item = group[name]
    if not isinstance(item, h5py.Dataset):
        raise KeyError(f"{name} is not a data set")
    return item[()]


def _group(parent: h5py.Group, name: str) -> h5py.Group:
    item = parent[name]
    if not isinstance(item, h5py.Group):
        raise KeyError(f"{name} is not a group")
    return item


def _attributes(group: h5py.Group) -> dict[str, Any]:
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in group.attrs.items()}


def _camera(group: h5py.Group) -> DltCamera:
    return DltCamera(_array(group, "dlt"), _array(group, "dlt_covariance"), _attributes(group)["rms_px"])


def _size(file: h5py.File, name: str) -> tuple[int, int]:
    width, height = (int(length) for length in _array(file, name))
    return width, height


def _read(file: h5py.File) -> Calibration:
    attributes = _attributes(file)
    cameras = {str(name): _camera(_group(file, f"cameras/{name}")) for name in _group(file, "cameras")}
    motion = {entry.name: _array(file, f"motion/{entry.name}") for entry in fields(TargetMotion)}
    return Calibration(
        left=cameras.pop("left"),
        right=cameras.pop("right"),
        control=ControlPoints(*(_array(file, f"control_points/{entry.name}") for entry in fields(ControlPoints))),
        choices=CalibrationChoices(
            **{entry.name: attributes[f"choice_{entry.name}"] for entry in fields(CalibrationChoices)}
        ),
        sigma_px=attributes["sigma_px"],
        epipolar_limit_px=attributes["epipolar_limit_px"],
        motion=TargetMotion(
            motion["direction"],
            motion["face_rotation"],
            motion["face_translation_mm"],
            float(motion["corner_reading_deg"]),
            float(motion["face_reading_deg"]),
        ),
        image_size_px={str(name): _size(file, f"image_size_px/{name}") for name in _group(file, "image_size_px")},
        reference=cameras,
        figures=_attributes(_group(file, "figures")),
        origins={name: str(text) for name, text in _attributes(_group(file, "origins")).items()},
        jack_mm=attributes["jack_mm"],
        lenses={str(name): LensCamera(_array(file, f"lenses/{name}")) for name in _group(file, "lenses")},
    )
