"""What the registry knows of the Aravis driver."""

from __future__ import annotations

from drivers.cameras.aravis.camera import AravisCamera
from drivers.cameras.aravis.discovery import list_cameras
from drivers.cameras.aravis.options import AravisOptions
from drivers.registry import DriverEntry

CAMERA = DriverEntry(
    "camera", AravisOptions, AravisCamera, "a GigE Vision or USB3 Vision camera, through Aravis", list_cameras
)
