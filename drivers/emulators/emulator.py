"""What every emulator is: started and stopped, at an address, with faults of the wire on command."""

from __future__ import annotations

from typing import Protocol

from drivers.emulators.wire import WireFaults


class Emulator(Protocol):
    """Devices behind one address; ``start`` and ``stop`` may be called twice, and leave no thread or file behind."""

    faults: WireFaults

    @property
    def address(self) -> str:
        """What a driver is given to reach it: ``tcp://127.0.0.1:7001``, ``/dev/pts/3``, ``127.0.0.1``."""
        ...

    @property
    def summary(self) -> str:
        """What it is, in a few words, for a person."""
        ...

    def start(self) -> None:
        """Serve, on threads of its own, on loopback only. Raises `OSError` when the address is taken."""
        ...

    def stop(self) -> None:
        """Stop serving and join its threads."""
        ...

    def power_cycle(self) -> None:
        """What switching the device off and on does: connections break, it no longer knows where it is."""
        ...
