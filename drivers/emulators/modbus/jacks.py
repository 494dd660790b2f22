"""The two lab jacks as AZ drives on one RS-485 line, or behind a Modbus TCP gateway."""

from __future__ import annotations

from typing import Literal

from drivers.clock import HostClock
from drivers.emulators.lines import Lines, PtyLine, TcpLine
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
    also_rtu : bool
        Serve the same drives behind a pseudo terminal too.
    """

    def __init__(
        self,
        axis: SimulatedAxis,
        *,
        transport: Literal["rtu", "tcp"] = "rtu",
        port: int = 0,
        steps_per_mm: float = STEPS_PER_MM,
        also_rtu: bool = False,
    ) -> None:
        self.faults = WireFaults()
        self.drives = tuple(AzDrive(carriage, steps_per_mm) for carriage in axis.carriages)
        units = dict(enumerate(self.drives, start=1))
        self._transport = transport
        gateway = TcpLine(lambda: TcpSession(units), self.faults, port=port, clients=GATEWAY_CLIENTS)
        serial = PtyLine(lambda: RtuSession(units, HostClock()), self.faults)
        self._gateway = Lines(gateway) if transport == "tcp" else Lines()
        self._serial = Lines(serial) if transport == "rtu" or also_rtu else Lines()

    @property
    def address(self) -> str:
        """What the driver is given."""
        return self.addresses[0]

    @property
    def addresses(self) -> tuple[str, ...]:
        """The same for each of its lines."""
        return (*self._gateway.addresses, *self._serial.addresses)

    @property
    def summary(self) -> str:
        """What it is."""
        return f"lab jacks, AZ drives, Modbus {self._transport.upper()}, units 1 and 2"

    def start(self) -> None:
        """Serve on loopback, or behind a pseudo terminal; after `stop` at the same address."""
        self._gateway.start()
        self._serial.start()

    def stop(self) -> None:
        """Stop serving, as pulling the host's cable does; the drives stay powered."""
        self._gateway.stop()
        self._serial.stop()

    def power_cycle(self) -> None:
        """Switch the drives (and a gateway) off and on; a serial line does not notice."""
        for drive in self.drives:
            drive.power_cycle()
        self._gateway.stop()
        self._gateway.start()
