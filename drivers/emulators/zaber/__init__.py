"""Zaber devices with simulated stages, on one line, behind their ASCII protocol."""

from drivers.emulators.zaber.emulator import ZaberEmulator

__all__ = ["ZaberEmulator"]
