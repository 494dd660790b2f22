"""The rig's two cameras behind GigE Vision at once, each at an address of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.emulators.gige.emulator import GigeEmulator
from drivers.simulated import SimulatedCamera


@dataclass(frozen=True, slots=True)
class ServedCameras:
    """The emulators that run, and for each camera that could not be served what to do about it."""

    emulators: tuple[GigeEmulator, ...]
    missing: tuple[str, ...]

    def stop(self) -> None:
        """Stop them all."""
        for emulator in self.emulators:
            emulator.stop()


def serve_cameras(cameras: Sequence[SimulatedCamera]) -> ServedCameras:
    """Serve cameras at 127.0.0.1, 127.0.0.2, ...; one for which there is no address is left out, and why is told.

    Raises `OSError` when not even the first can be served.
    """
    running: list[GigeEmulator] = []
    missing: list[str] = []
    for number, camera in enumerate(cameras, start=1):
        emulator = GigeEmulator(camera, f"127.0.0.{number}")
        try:
            emulator.start()
        except OSError as error:
            if not running:
                raise
            missing.append(f"the {camera.options.camera} camera is not served: {error}")
        else:
            running.append(emulator)
    return ServedCameras(tuple(running), tuple(missing))
