"""What happens, as it happens: server-sent events with ids, and those that were missed."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request
from sse_starlette import EventSourceResponse, ServerSentEvent

from bscd.api.security import StreamViewer, TheDaemon
from bscd.daemon.events import Subscription

router = APIRouter(tags=["events"])

#: How often a listener's queue is looked at; no thread waits for it.
_LOOK_S = 0.03
_PING_S = 15
_SEND_S = 10.0

_MOST_ID = 2**62


@router.get(
    "/events",
    response_class=EventSourceResponse,
    responses={200: {"description": "events until the listener leaves", "content": {"text/event-stream": {}}}},
)
async def events(
    request: Request,
    daemon: TheDaemon,
    who: StreamViewer,
    last_event_id: Annotated[int | None, Header(ge=0, le=_MOST_ID, description="go on after this one")] = None,
    after: Annotated[int | None, Query(ge=0, le=_MOST_ID, description="the same, where no header can be sent")] = None,
) -> EventSourceResponse:
    """Events from now on, or after an id; "gone" says that some in between are not kept any more."""
    subscription = daemon.events.subscribe(after=last_event_id if last_event_id is not None else after)
    return EventSourceResponse(_told(subscription, request.app.state.closing), ping=_PING_S, send_timeout=_SEND_S)


async def _told(subscription: Subscription, closing: asyncio.Event) -> AsyncIterator[ServerSentEvent]:
    told_lost = 0
    with subscription:
        while not closing.is_set():
            if subscription.lost > told_lost:
                told_lost = subscription.lost
                yield ServerSentEvent(event="gone", data=json.dumps({"lost": told_lost}))
            event = subscription.get(0.0)
            if event is None:
                await asyncio.sleep(_LOOK_S)
            else:
                yield ServerSentEvent(event=event.kind, id=str(event.id), data=event.text)
