"""One Modbus line with its devices: an exchange at a time, from any thread, and never an answer to another question.

On TCP a failed exchange closes the connection, so what comes late is lost with it. A serial port stays open, and a
late answer would be taken for the next one: after a failed exchange with a device the next one with it begins with
the echo of function 8, whose data nobody else can know. A device answers in order, so once the echo is back nothing
older can come.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count

from pymodbus.exceptions import ConnectionException
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.diag_message import ReturnQueryDataResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse, WriteMultipleRegistersResponse

from drivers.clock import Clock
from drivers.errors import DeviceBusyError, DeviceError, DeviceTimeoutError, NotConnectedError, ProtocolError
from drivers.modbus.answers import refusal
from drivers.modbus.port import Client, SerialSettings, is_tcp, open_client

ECHO_ATTEMPTS = 3
READ, ECHO, WRITE, REFUSED = 3, 8, 16, 0x80
WAITING_TIMEOUTS = 20.0
_LOG = logging.getLogger(__name__)
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)  # what it logs is raised here, as errors of ours


class Line:
    """A Modbus TCP connection or an RS-485 line; safe to use from any thread.

    Parameters
    ----------
    device : str
        Name of the device, for messages.
    address : str
        ``tcp://HOST:PORT`` or the path of a serial port.
    settings : SerialSettings
        How the serial port talks.
    timeout_s : float
        How long an exchange waits for its answer; one that comes in pieces may take twice as long.
    clock : Clock
        Keeps frames apart on a serial line.
    greet : callable, optional
        Called whenever the line has been opened, to see who is there and to set it up.
    """

    def __init__(
        self,
        device: str,
        address: str,
        settings: SerialSettings,
        timeout_s: float,
        clock: Clock,
        *,
        greet: Callable[[], None] | None = None,
    ) -> None:
        self._device = device
        self._address = address
        self._settings = settings
        self._timeout_s = timeout_s
        self._clock = clock
        self._greet = greet
        self._lock = threading.RLock()
        self._wanted = False
        self._lost = False
        self._client: Client | None = None
        self._received = False
        self._fresh = False
        self._free_at_s = -float("inf")
        self._doubtful: set[int] = set()
        self._tokens = count(0x5A01)

    @property
    def is_open(self) -> bool:
        """Whether the line has been opened and not been closed; it may be lost at the moment."""
        return self._wanted

    def open(self) -> None:
        """Open the port; does nothing when open. Raises `NotConnectedError` or `DeviceBusyError`."""
        with self._held("connecting"):
            if self._wanted:
                return
            self._wanted, self._lost = True, False
            try:
                self._reopen()
            except DeviceError:
                self._wanted = False
                raise

    def close(self) -> None:
        """Close the port; never raises, may be called twice."""
        held = self._lock.acquire(timeout=WAITING_TIMEOUTS * self._timeout_s)
        self._wanted = False
        self._drop()
        self._doubtful.clear()
        if held:
            self._lock.release()

    def require_open(self, doing: str) -> None:
        """Raise `NotConnectedError` when not opened; sends nothing."""
        if not self._wanted:
            raise NotConnectedError(self._device, f"{doing}: it is not connected", "call connect() first")

    def read(self, unit: int, address: int, registers: int, doing: str) -> list[int]:
        """The values of holding registers (function 3).

        Raises `NotConnectedError`, `DeviceTimeoutError`, `ProtocolError`, or what the device's refusal means.
        """
        with self._ready(unit, doing) as client:
            ask = partial(client.read_holding_registers, address, count=registers, device_id=unit)
            answer = self._ask(unit, doing, READ, ask)
            if not isinstance(answer, ReadHoldingRegistersResponse) or len(answer.registers) != registers:
                raise self._doubt(unit, self._mistaken(doing))
            return list(answer.registers)

    def write(self, unit: int, address: int, values: Sequence[int], doing: str) -> None:
        """Write holding registers in one message (function 16); raises as `read` does."""
        with self._ready(unit, doing) as client:
            ask = partial(client.write_registers, address, list(values), device_id=unit)
            answer = self._ask(unit, doing, WRITE, ask)
            echoed = isinstance(answer, WriteMultipleRegistersResponse) and (answer.address, answer.count)
            if echoed != (address, len(values)):
                raise self._doubt(unit, self._mistaken(doing))

    @contextmanager
    def _held(self, doing: str) -> Iterator[None]:
        if not self._lock.acquire(timeout=WAITING_TIMEOUTS * self._timeout_s):
            raise DeviceTimeoutError(self._device, f"{doing}: the line is not free", "look what else it is busy with")
        try:
            yield
        finally:
            self._lock.release()

    @contextmanager
    def alone(self, unit: int, doing: str) -> Iterator[None]:
        """Hold the line, open and with nothing old on it, so that what is timed here is the exchange and no wait."""
        with self._ready(unit, doing):
            yield

    @contextmanager
    def _ready(self, unit: int, doing: str) -> Iterator[Client]:
        """The open client, with no answer of this unit still to come."""
        with self._held(doing):
            self.require_open(doing)
            if self._client is None:
                self._reopen()
            if unit in self._doubtful:
                self._clear_up(unit, doing)
            if self._client is None:
                raise NotConnectedError(self._device, f"{doing}: the line is lost", "check its power and its cable")
            yield self._client

    def _reopen(self) -> None:
        client = open_client(self._device, self._address, self._settings, self._timeout_s, self._trace)
        self._client, self._fresh = client, True
        try:
            if self._greet is not None:
                self._greet()
        except DeviceError:
            self._drop()
            raise
        if self._lost:
            self._lost = False
            _LOG.info("%s: %s is back", self._device, self._address)

    def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _ask(self, unit: int, doing: str, function: int, send: Callable[[], ModbusPDU]) -> ModbusPDU:
        """What the device answers; raises what its refusal means."""
        answer = self._exchange(unit, doing, send)
        if answer.function_code & ~REFUSED != function:
            raise self._doubt(unit, self._mistaken(doing))
        if answer.isError():
            raise refusal(self._device, doing, answer)
        return answer

    def _exchange(self, unit: int, doing: str, send: Callable[[], ModbusPDU]) -> ModbusPDU:
        """Send and take a valid answer, a refusal too; raises when there is none."""
        if not is_tcp(self._address):
            self._clock.sleep(self._free_at_s - self._clock.now_s())
        self._received = False
        try:
            answer = send()
            self._fresh = False
            return answer
        except (ConnectionException, OSError) as error:
            if self._fresh and is_tcp(self._address):
                self._drop()
                words = f"{doing}: {self._address} hung up at once"
                raise DeviceBusyError(
                    self._device, words, "end the other program that holds its connections"
                ) from error
            self._lose()
            words = f"{doing}: the line to {self._address} broke"
            raise NotConnectedError(self._device, words, "check its power and its cable") from error
        except Exception as error:  # pymodbus: no answer, or bytes that it can not decode
            raise self._doubt(unit, self._nothing_valid(doing)) from error
        finally:
            self._free_at_s = self._clock.now_s() + self._settings.silence_s

    def _nothing_valid(self, doing: str) -> DeviceError:
        if self._received:
            words = f"{doing}: the answer is garbled or cut short"
            return ProtocolError(self._device, words, "check the cable, its termination and the serial settings")
        words = f"{doing}: no answer within {self._timeout_s:g} s"
        return DeviceTimeoutError(self._device, words, "check its power and its cable")

    def _mistaken(self, doing: str) -> DeviceError:
        words = f"{doing}: the answer is to another question"
        return ProtocolError(self._device, words, "raise answer_timeout_s above the slowest answer")

    def _doubt(self, unit: int, error: DeviceError) -> DeviceError:
        """Note that an answer of ``unit`` may still come."""
        if is_tcp(self._address):
            self._drop()
        else:
            self._doubtful.add(unit)
        return error

    def _lose(self) -> None:
        self._drop()
        if not self._lost:
            self._lost = True
            _LOG.warning("%s: %s is lost", self._device, self._address)

    def _clear_up(self, unit: int, doing: str) -> None:
        """Let all that is late come in, up to the echo of data that only the newest request has (or its refusal)."""
        client = self._client
        if client is None:
            return
        for _ in range(ECHO_ATTEMPTS):
            data = (next(self._tokens) % 0x10000).to_bytes(2, "big")
            echo = partial(client.diag_query_data, data, device_id=unit)
            answer = self._exchange(unit, f"{doing}: clearing the line", echo)
            if isinstance(answer, ExceptionResponse) and answer.function_code == ECHO | REFUSED:
                break
            if isinstance(answer, ReturnQueryDataResponse) and answer.message == data:
                break
        else:
            words = f"{doing}: old answers keep coming"
            raise ProtocolError(self._device, words, "raise answer_timeout_s above the slowest answer")
        self._doubtful.discard(unit)

    def _trace(self, sending: bool, data: bytes) -> bytes:
        if not sending and data:
            self._received = True
        return data
