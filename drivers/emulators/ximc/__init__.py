"""A Standa XIMC controller (8SMC4/8SMC5) with a simulated stage, behind its serial protocol."""

from drivers.emulators.ximc.emulator import XimcEmulator

__all__ = ["XimcEmulator"]
