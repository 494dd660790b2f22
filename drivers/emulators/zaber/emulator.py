"""Simulated stages as Zaber devices on one line."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

from drivers.emulators.lines import Transport, open_lines
from drivers.emulators.wire import WireFaults
from drivers.emulators.zaber.device import ZaberDevice
from drivers.emulators.zaber.session import ZaberSession
from drivers.simulated import SimulatedAxis


class ZaberEmulator:
    """Devices at the addresses 1, 2, ... of one line; see `drivers.emulators.emulator.Emulator`.

    Parameters
    ----------
    stages : sequence of (SimulatedAxis, float)
        A simulated axis for each address, with its microsteps per mm or deg; one of two motors has two axes. Its
        resolution should be a microstep or less.
    transport : str
        "pty" or "tcp".
    port : int
        The TCP port, 0 for a free one.
    also_pty : bool
        Serve the same behind a pseudo-terminal too.
    """

    def __init__(
        self,
        stages: Sequence[tuple[SimulatedAxis, float]],
        *,
        transport: Transport = "pty",
        port: int = 0,
        also_pty: bool = False,
    ) -> None:
        self.faults = WireFaults()
        self.devices = [
            ZaberDevice(address, axis.carriages, microsteps, zlib.crc32(axis.name.encode()) % 100_000)
            for address, (axis, microsteps) in enumerate(stages, start=1)
        ]
        self._names = ", ".join(f"{axis.name} ({address})" for address, (axis, _) in enumerate(stages, start=1))
        self._lines = open_lines(
            transport, lambda: ZaberSession(self.devices), self.faults, port=port, also_pty=also_pty
        )

    @property
    def address(self) -> str:
        """What the driver is given as its port."""
        return self._lines.addresses[0]

    @property
    def addresses(self) -> tuple[str, ...]:
        """The same for each of its lines."""
        return self._lines.addresses

    @property
    def summary(self) -> str:
        """What it is, in a few words."""
        return f"Zaber devices: {self._names}"

    def start(self) -> None:
        """Serve; also plugs it in again after `stop`. Raises `OSError` when the address is taken."""
        self._lines.start()

    def stop(self) -> None:
        """Stop serving, as pulling its plug does."""
        self._lines.stop()

    def power_cycle(self) -> None:
        """Switch all devices off and on: the connection breaks, and none is homed."""
        self._lines.stop()
        for device in self.devices:
            device.power_cycle()
        self._lines.start()
