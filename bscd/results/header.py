"""Read back what describes results as a whole."""

from __future__ import annotations

from typing import get_args

import h5py
import numpy as np

from bscd.hdf5 import dataset_at, group_at, read_identity, text_at
from bscd.results.layout import DATA, MEASUREMENT, PARAMETERS
from bscd.results.records import MembraneFrame, Origin, ParameterValue, ResultsHeader, StereoSource


def read_header(file: h5py.File) -> ResultsHeader:
    """The header that `bscd.results.skeleton.create_skeleton` wrote; `KeyError` where a part is missing."""
    measurement, identity = group_at(file, MEASUREMENT), read_identity(file)
    return ResultsHeader(
        title=identity.title,
        run=_origin(group_at(measurement, "run")),
        calibration=_origin(group_at(measurement, "calibration")),
        points_px=np.asarray(dataset_at(file, f"{DATA}/points_px")[()], np.float64),
        status_names=_status_names(dataset_at(file, f"{DATA}/status")),
        stereo=_stereo(text_at(measurement, "stereo")),
        reference_frames=tuple(int(number) for number in dataset_at(measurement, "reference_frames")[()]),
        membrane=_membrane(measurement),
        parameters=_parameters(group_at(file, PARAMETERS)),
        uuid=identity.uuid,
        start_time=identity.start_time,
        program_version=identity.program_version,
    )


def _origin(group: h5py.Group) -> Origin:
    return Origin(text_at(group, "file_name"), text_at(group, "uuid"), text_at(group, "sha256"))


def _stereo(text: str) -> StereoSource:
    for known in get_args(StereoSource):
        if text == known:
            return known
    raise KeyError(f"stereo is {text!r}")


def _membrane(measurement: h5py.Group) -> MembraneFrame | None:
    if "membrane_frame" not in measurement:
        return None
    group = group_at(measurement, "membrane_frame")
    return MembraneFrame(
        np.asarray(dataset_at(group, "origin_mm")[()], np.float64), np.asarray(dataset_at(group, "axes")[()])
    )


def _status_names(status: h5py.Dataset) -> dict[int, str]:
    codes, names = status.attrs["codes"], status.attrs["code_names"]
    if not isinstance(codes, np.ndarray) or not isinstance(names, np.ndarray):
        raise KeyError("the status codes are no list")
    return {int(code): str(name) for code, name in zip(codes, names, strict=True)}


def _parameters(group: h5py.Group) -> dict[str, ParameterValue]:
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in group.attrs.items()
        if name != "NX_class"
    }
