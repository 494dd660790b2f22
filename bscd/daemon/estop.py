"""The e-stop: past queue, locks and event loop to every device at once, latched until an operator resets it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime

from bscd.daemon.documents import EStopDocument
from bscd.daemon.guards import Latch
from drivers.errors import DeviceError

#: How long `EmergencyStop.trigger` waits for the slowest device's command; the device's thread goes on.
ANSWER_S = 1.0

#: A motion that slipped through as the latch closed is stopped again so often, for so long.
_AGAIN_S = 0.02
_AGAIN_FOR_S = 30.0


class EmergencyStop:
    """One waiting thread for each device, so that none waits for another; ``commands`` stop or vent by device name.

    ``on_trigger`` is called once a trigger, after the commands were given, on the triggering thread. `close` joins.
    """

    def __init__(
        self,
        latch: Latch,
        commands: Mapping[str, Callable[[], object]],
        on_trigger: Callable[[EStopDocument], None] = lambda _: None,
    ) -> None:
        self._latch, self._on_trigger = latch, on_trigger
        self._lock = threading.Lock()
        self._begun = self._ended = 0
        self._document = EStopDocument(latched=False)
        self._devices = [_Device(name, command, latch) for name, command in commands.items()]

    @property
    def latched(self) -> bool:
        """Whether nothing may move."""
        return self._latch.closed

    def document(self) -> EStopDocument:
        """The last trigger, and whether anything holds now."""
        return self._document.model_copy(update={"latched": self._latch.closed})

    def trigger(self, by: str, reason: str = "") -> EStopDocument:
        """Stop every axis and vent, from any thread and in every state; may be called again."""
        with self._lock:
            self._begun += 1
            self._latch.close()
        begun = time.monotonic_ns()
        rounds = [device.trigger() for device in self._devices]
        ends = time.monotonic() + ANSWER_S
        for device, number in zip(self._devices, rounds, strict=True):
            device.wait(number, max(ends - time.monotonic(), 0.0))
        last_ns = max((device.given_ns for device in self._devices), default=begun)
        late = [f"{one.name}: its stop command was not given in {ANSWER_S:g} s" for one in self._devices if one.busy]
        failures = (*late, *(one.failure for one in self._devices if one.failure))
        document = EStopDocument(
            latched=True,
            by=by if not reason else f"{by}: {reason}",
            at=datetime.now(UTC),
            took_ms=(last_ns - begun) * 1e-6,
            failures=failures,
        )
        with self._lock:
            self._document = document
        try:
            self._on_trigger(document)
        finally:
            with self._lock:
                self._ended += 1
        return document

    def triggers(self) -> int | None:
        """How often it was triggered so far; None while a trigger is under way."""
        with self._lock:
            return self._begun if self._begun == self._ended else None

    def reset(self, triggers: int) -> bool:
        """Let things move again, nothing does by itself; False, and nothing may, when it was triggered since."""
        with self._lock:
            if triggers != self._begun:
                return False
            self._latch.open()
            return True

    def close(self) -> None:
        """End the threads."""
        for device in self._devices:
            device.close()


class _Device:
    """A device's stop command on a thread of its own."""

    def __init__(self, name: str, command: Callable[[], object], latch: Latch) -> None:
        self.name = name
        self.failure = ""
        self.given_ns = 0
        self._command, self._latch = command, latch
        self._condition = threading.Condition()
        self._asked = self._done = 0
        self._ending = False
        self._thread = threading.Thread(target=self._run, name=f"e-stop {name}", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a command was asked for that has not been given."""
        return self._done < self._asked

    def trigger(self) -> int:
        """Have the command given; the number to wait for."""
        with self._condition:
            self._asked += 1
            self._condition.notify_all()
            return self._asked

    def wait(self, number: int, timeout_s: float) -> None:
        with self._condition:
            self._condition.wait_for(lambda: self._done >= number, timeout_s)

    def close(self) -> None:
        with self._condition:
            self._ending = True
            self._condition.notify_all()
        self._thread.join(ANSWER_S)

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self.busy or self._ending)
                if self._ending:
                    return
                number = self._asked
            self._give()
            with self._condition:
                self._done = number
                self._condition.notify_all()
            self._until_at_rest()

    def _give(self) -> None:
        try:
            self._command()
            self.failure = ""
        except DeviceError as error:
            self.failure = str(error)
        except Exception as error:  # a driver's mistake must not end the e-stop's thread
            self.failure = f"{self.name}: {type(error).__name__}: {error}"
        self.given_ns = time.monotonic_ns()

    def _until_at_rest(self) -> None:
        ends = time.monotonic() + _AGAIN_FOR_S
        while self._latch.closed and self._latch.under_way(self.name) and time.monotonic() < ends:
            with self._condition:
                if self._condition.wait_for(lambda: self.busy or self._ending, _AGAIN_S):
                    return
            self._give()
