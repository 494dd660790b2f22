"""Aravis through PyGObject, loaded when it is first needed; its errors become ours here and nowhere else."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceTimeoutError,
    NotConnectedError,
    ProtocolError,
    UnsupportedError,
)

HOW_TO_GET_IT = (
    "run: apt-get install gir1.2-aravis-0.8 libgirepository1.0-dev libcairo2-dev pkg-config gcc, "
    "then pip install 'bscd[aravis]'"
)

CHECK_LINE = "check its power and its cable, and that it is in this computer's subnet"


def aravis_for(device: str) -> Any:
    """The Aravis namespace. Raises `NotConnectedError` that tells how to get it."""
    try:
        return _load()
    except (ImportError, ValueError) as err:
        raise NotConnectedError(device, f"Aravis can not be loaded ({err})", HOW_TO_GET_IT) from err


@cache
def _load() -> Any:
    gi = importlib.import_module("gi")
    gi.require_version("Aravis", "0.8")
    return importlib.import_module("gi.repository.Aravis")


@contextmanager
def library_errors(device: str, doing: str) -> Iterator[None]:
    """Turn an error of GLib into one of `drivers.errors`."""
    try:
        yield
    except DeviceError:
        raise
    except Exception as err:
        if not hasattr(err, "domain") or not hasattr(err, "code"):
            raise
        raise _ours(err, device, doing) from err


def _ours(err: Any, device: str, doing: str) -> DeviceError:
    what = f"{doing}: {err.message}"
    if err.domain != "arv-device-error-quark":
        return ProtocolError(device, what, "compare the options with what `arv-tool-0.8 features` lists")
    codes = _load().DeviceError
    if err.code == codes.TIMEOUT:
        return DeviceTimeoutError(device, f"{doing}: no answer ({err.message})", CHECK_LINE)
    if err.code in (codes.NOT_FOUND, codes.NOT_CONNECTED):
        return NotConnectedError(device, what, CHECK_LINE)
    if err.code in (codes.NOT_CONTROLLER, codes.PROTOCOL_ERROR_ACCESS_DENIED, codes.PROTOCOL_ERROR_BUSY):
        return DeviceBusyError(device, what, "end the other program that uses it")
    if err.code in (codes.FEATURE_NOT_FOUND, codes.WRONG_FEATURE):
        return UnsupportedError(device, what, "compare the options with what `arv-tool-0.8 features` lists")
    return ProtocolError(device, what, "switch it off and on when this comes again")
