"""Find the camera that the options mean, and open it."""

from __future__ import annotations

import threading
from typing import Any

from drivers.cameras.aravis.library import CHECK_LINE, aravis_for, library_errors
from drivers.cameras.aravis.options import AravisOptions
from drivers.clock import Clock
from drivers.errors import DeviceBusyError, NotConnectedError

_BUSY_PAUSE_S = 0.5
_searching = threading.Lock()
"""Aravis's list of devices is one for the whole process."""


def open_camera(options: AravisOptions, device: str, clock: Clock, *, patience_s: float) -> Any:
    """The open ``Aravis.Camera``, under our control.

    Raises `NotConnectedError` when it is not found, `DeviceBusyError` when another program still has it after
    ``patience_s`` (a program that crashed keeps it for the camera's heartbeat time-out, 3 s on most).
    """
    doing = "connecting"
    aravis = aravis_for(device)
    deadline_s = clock.now_s() + patience_s
    while True:
        with library_errors(device, doing):
            camera = aravis.Camera.new(options.address or _device_id(aravis, options, device))
            if not camera.is_gv_device() or camera.get_device().is_controller():
                return camera
        del camera
        if clock.now_s() >= deadline_s:
            raise DeviceBusyError(device, f"{doing}: another program controls this camera", "end that program")
        clock.sleep(_BUSY_PAUSE_S)


def list_cameras() -> list[str]:
    """Every camera that answers now, a line each. Raises `NotConnectedError` where Aravis is missing."""
    aravis = aravis_for("camera.aravis")
    with _searching, library_errors("camera.aravis", "looking for cameras"):
        aravis.update_device_list()
        lines = []
        for index in range(aravis.get_n_devices()):
            told = (aravis.get_device_vendor(index), aravis.get_device_model(index))
            lines.append(
                f'serial = "{aravis.get_device_serial_nbr(index)}", {aravis.get_device_protocol(index)} '
                f"at {aravis.get_device_address(index)}: {' '.join(part for part in told if part)}"
            )
        return lines


def _device_id(aravis: Any, options: AravisOptions, device: str) -> str:
    with _searching:
        aravis.update_device_list()
        found = {
            str(aravis.get_device_serial_nbr(index)): str(aravis.get_device_id(index))
            for index in range(aravis.get_n_devices())
        }
    seen = f"seen: {', '.join(sorted(found)) or 'none'}"
    if options.serial:
        if options.serial not in found:
            raise NotConnectedError(device, f"no camera with the serial {options.serial!r} ({seen})", CHECK_LINE)
        return found[options.serial]
    if len(found) != 1:
        hint = "give its serial or address" if found else CHECK_LINE
        raise NotConnectedError(device, f"not exactly one camera is there ({seen})", hint)
    return next(iter(found.values()))
