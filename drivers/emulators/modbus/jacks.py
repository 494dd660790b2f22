"""The two lab jacks as AZ drives on one RS-485 line, or behind a Modbus TCP gateway."""

from __future__ import annotations

from typing import Literal

from drivers.emulators.modbus.az_drive import AzDrive
from drivers.emulators.modbus.rtu import RtuServer
from drivers.emulators.modbus.tcp import TcpServer
from drivers.emulators.wire import WireFaults
from drivers.simulated.axis import SimulatedAxis

STEPS_PER_MM = 100.0


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
        self._server: TcpServer | RtuServer
        if transport == "tcp":
            self._server = TcpServer(units, self.faults, port=port)
        else:
            self._server = RtuServer(units, self.faults)

    @property
    def address(self) -> str:
        """What the driver is given."""
        return self._server.address

    @property
    def summary(self) -> str:
        """What it is."""
        return f"lab jacks, AZ drives, Modbus {self._transport.upper()}, units 1 and 2"

    def start(self) -> None:
        """Serve on loopback, or behind a pseudo terminal."""
        self._server.start()

    def stop(self) -> None:
        """Stop serving."""
        self.faults.clear()
        self._server.stop()

    def unplug(self) -> None:
        """Pull the cable at the host's end; the drives stay powered. `start` plugs it in again."""
        self._server.unplug()

    def power_cycle(self) -> None:
        """Switch the drives (and a gateway) off and on; a serial line does not notice."""
        for drive in self.drives:
            drive.power_cycle()
        self._server.drop()
