"""The two lab jacks as AZ drives on one RS-485 line, or behind a Modbus TCP gateway."""

from __future__ import annotations

from typing import Literal

from drivers.clock import HostClock
from drivers.emulators.lines import PtyLine, TcpLine
from drivers.emulators.modbus.az_drive import AzDrive
from drivers.emulators.modbus.sessions import RtuSession, TcpSession
from drivers.emulators.wire import WireFaults
from drivers.simulated.axis import SimulatedAxis

STEPS_PER_MM = 100.0
GATEWAY_CLIENTS = 1


class ModbusJacksEmulator:
    """See `drivers.emulators.emulator.Emulator`.

    Parameters
    ----------
    axis : SimulatedAxis
        The jacks on the twin; its motors become units 1 (lower) and 2 (upper).
    transport : {"rtu", "tcp"}
        Modbus RTU behind a pseudo terminal, or Modbus TCP.
    port : int
        TCP port; 0 takes a free one.
    steps_per_mm : float
        What the drives are set to.
    """

    def __init__(
        self,
        axis: SimulatedAxis,
        *,
        transport: Literal["rtu", "tcp"] = "rtu",
        port: int = 0,
        steps_per_mm: float = STEPS_PER_MM,
    ) -> None:
        self.faults = WireFaults()
        self.drives = tuple(AzDrive(carriage, steps_per_mm) for carriage in axis.carriages)
        units = dict(enumerate(self.drives, start=1))
        self._transport = transport
        self._line: TcpLine | PtyLine
        if transport == "tcp":
            self._line = TcpLine(lambda: TcpSession(units), self.faults, port=port, clients=GATEWAY_CLIENTS)
        else:
            self._line = PtyLine(lambda: RtuSession(units, HostClock()), self.faults)

    @property
    def address(self) -> str:
        """What the driver is given."""
        return self._line.address

    @property
    def summary(self) -> str:
        """What it is."""
        return f"lab jacks, AZ drives, Modbus {self._transport.upper()}, units 1 and 2"

    def start(self) -> None:
        """Serve on loopback, or behind a pseudo terminal; after `stop` at the same address."""
        self._line.start()

    def stop(self) -> None:
        """Stop serving, as pulling the host's cable does; the drives stay powered."""
        self._line.stop()

    def power_cycle(self) -> None:
        """Switch the drives (and a gateway) off and on; a serial line does not notice."""
        for drive in self.drives:
            drive.power_cycle()
        if self._transport == "tcp":
            self._line.stop()
            self._line.start()
