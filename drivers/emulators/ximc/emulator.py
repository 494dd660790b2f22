"""A simulated stage behind an XIMC controller's port."""

from __future__ import annotations

import zlib

from drivers.emulators.lines import Transport, open_lines
from drivers.emulators.wire import WireFaults
from drivers.emulators.ximc.controller import XimcController
from drivers.emulators.ximc.messages import XimcSession
from drivers.simulated import SimulatedAxis

STEPS_PER_UNIT = {"deg": 100.0, "mm": 400.0}
"""The paper's stages: 0.01 deg and 2.5 um a step."""


class XimcEmulator:
    """One controller with one motor at a port of its own; see `drivers.emulators.emulator.Emulator`.

    Parameters
    ----------
    axis : SimulatedAxis
        A simulated axis of one motor, whose resolution should be a microstep or less.
    unit : str
        "mm" or "deg", the axis's.
    steps_per_unit : float or None
        Full steps per mm or deg; None takes the paper's stage.
    transport : str
        "pty" or "tcp".
    port : int
        The TCP port, 0 for a free one.
    also_pty : bool
        Serve the same behind a pseudo-terminal too.
    """

    def __init__(
        self,
        axis: SimulatedAxis,
        unit: str,
        *,
        steps_per_unit: float | None = None,
        transport: Transport = "pty",
        port: int = 0,
        also_pty: bool = False,
    ) -> None:
        if len(axis.carriages) != 1:
            raise ValueError(f"{axis.name}: an XIMC controller drives one motor, not {len(axis.carriages)}")
        self.faults = WireFaults()
        serial_number = zlib.crc32(axis.name.encode()) % 100_000
        self.controller = XimcController(axis.carriages[0], steps_per_unit or STEPS_PER_UNIT[unit], serial_number)
        self._name = axis.name
        self._lines = open_lines(
            transport, lambda: XimcSession(self.controller), self.faults, port=port, also_pty=also_pty
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
        return f"{self._name}: Standa XIMC controller"

    def start(self) -> None:
        """Serve; also plugs it in again after `stop`. Raises `OSError` when the address is taken."""
        self._lines.start()

    def stop(self) -> None:
        """Stop serving, as pulling its plug does."""
        self._lines.stop()

    def power_cycle(self) -> None:
        """Switch off and on: the connection breaks, what was not saved is gone, and it is not homed."""
        self._lines.stop()
        self.controller.power_cycle()
        self._lines.start()
