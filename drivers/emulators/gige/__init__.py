"""The twin's cameras behind GigE Vision: real GVCP and GVSP packets, served by Aravis's fake camera."""

from drivers.emulators.gige.emulator import GigeEmulator
from drivers.emulators.gige.serving import ServedCameras, serve_cameras

__all__ = ["GigeEmulator", "ServedCameras", "serve_cameras"]
