"""Events as they happen: numbered, kept for a while, and handed to whoever listens without waiting for anyone."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from dataclasses import dataclass
from datetime import UTC, datetime
from types import TracebackType
from typing import Any, Literal, Self

EventKind = Literal["state", "job", "device", "live", "estop", "warning"]


@dataclass(frozen=True)
class Event:
    """Something that happened; ids grow by one, also over restarts (see `first_id`).

    ``text`` is its content as JSON, written once for all listeners: a live map's takes a tenth of the memory so.
    """

    id: int
    kind: EventKind
    text: str

    @property
    def data(self) -> dict[str, Any]:
        """The content, with its ``time`` (ISO 8601, UTC)."""
        return json.loads(self.text)


def first_id() -> int:
    """An id greater than any that an earlier process gave: it counts from the clock's microseconds.

    So an id of before a restart is told from one of now, as long as fewer than a million events happen a second.
    """
    return time.time_ns() // 1000


class EventLog:
    """The last ``keep`` events, as far as ``keep_bytes`` hold them; `publish` never waits, from any thread."""

    def __init__(self, keep: int = 5000, keep_bytes: int = 8_000_000, first: int | None = None) -> None:
        self._lock = threading.Lock()
        self._next = first_id() if first is None else first
        self._keep, self._keep_bytes = keep, keep_bytes
        self._kept: deque[Event] = deque()
        self._kept_bytes = 0
        self._subscriptions: set[Subscription] = set()

    @property
    def last_id(self) -> int:
        """Of the newest event; one less than the first id before there is any."""
        return self._next - 1

    def publish(self, kind: EventKind, data: dict[str, Any]) -> Event:
        """Tell everyone ``data``, plain enough for JSON; a listener who is slow loses its oldest, and only its own."""
        text = json.dumps({"time": datetime.now(UTC).isoformat(), **data}, allow_nan=False)
        with self._lock:
            event = Event(self._next, kind, text)
            self._next += 1
            self._kept.append(event)
            self._kept_bytes += len(text)
            while len(self._kept) > self._keep or self._kept_bytes > self._keep_bytes:
                self._kept_bytes -= len(self._kept.popleft().text)
            for subscription in self._subscriptions:
                subscription.offer(event)
        return event

    def since(self, event_id: int) -> tuple[list[Event], bool]:
        """The events after that id, and whether some of those are gone (or it is no id of this log)."""
        with self._lock:
            return self._since(event_id)

    def subscribe(self, depth: int = 1000, after: int | None = None) -> Subscription:
        """Listen from now on, or from those ``after`` an id on; `Subscription.lost` counts what is gone of them."""
        with self._lock:
            subscription = Subscription(self._leave, depth)
            if after is not None:
                events, gone = self._since(after)
                subscription.lost += int(gone)
                for event in events:
                    subscription.offer(event)
            self._subscriptions.add(subscription)
            return subscription

    def _since(self, event_id: int) -> tuple[list[Event], bool]:
        first = self._kept[0].id if self._kept else self._next
        events = [event for event in self._kept if event.id > event_id]
        return events, event_id < first - 1 or event_id >= self._next

    def _leave(self, subscription: Subscription) -> None:
        with self._lock:
            self._subscriptions.discard(subscription)


class Subscription:
    """A listener's own bounded queue; a context manager that leaves at its end."""

    def __init__(self, leave: Any, depth: int) -> None:
        self._leave = leave
        self._condition = threading.Condition()
        self._events: deque[Event] = deque(maxlen=depth)
        self.lost = 0

    def offer(self, event: Event) -> None:
        """Put one in, in place of the oldest where there is no room."""
        with self._condition:
            self.lost += len(self._events) == self._events.maxlen
            self._events.append(event)
            self._condition.notify()

    def get(self, timeout_s: float) -> Event | None:
        """The next event, None when there is none in that time."""
        with self._condition:
            self._condition.wait_for(lambda: bool(self._events), timeout_s)
            return self._events.popleft() if self._events else None

    def __enter__(self) -> Self:
        """The subscription."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Listen no more."""
        self._leave(self)
