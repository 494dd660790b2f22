"""A line that keeps what it hears, with an emulated device behind it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.emulators.lines import Session, TcpLine
from drivers.emulators.wire import WireFaults
from drivers.emulators.ximc.controller import XimcController
from drivers.emulators.ximc.messages import XimcSession
from drivers.emulators.zaber.device import ZaberDevice
from drivers.emulators.zaber.session import ZaberSession
from tests.drivers.stages.rigs import MICROSTEPS_PER_UNIT, STEPS_PER_UNIT, simulated


class Recording:
    """Keeps all bytes that were sent to a session, and hands them on."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._heard = bytearray()

    def receive(self, data: bytes) -> Iterator[bytes]:
        self._heard += data
        yield from self._session.receive(data)

    def taken(self) -> bytes:
        """What was heard since this was asked the last time."""
        heard = bytes(self._heard)
        self._heard.clear()
        return heard


@contextmanager
def recorded(session: Session) -> Iterator[tuple[str, Recording]]:
    """The address of a line to a session, and what it hears."""
    recording = Recording(session)
    line = TcpLine(lambda: recording, WireFaults())
    line.start()
    try:
        yield line.address, recording
    finally:
        line.stop()


def ximc_session(unit: str = "mm") -> XimcSession:
    motor = simulated(unit, STEPS_PER_UNIT[unit] * 256).carriages[0]
    return XimcSession(XimcController(motor, STEPS_PER_UNIT[unit], 4711))


def zaber_session(unit: str = "mm") -> ZaberSession:
    motors = simulated(unit, MICROSTEPS_PER_UNIT[unit]).carriages
    return ZaberSession([ZaberDevice(1, motors, MICROSTEPS_PER_UNIT[unit], 4711)])
