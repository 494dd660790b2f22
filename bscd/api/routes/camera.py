"""What the cameras see: a snapshot, and a stream of the newest frames that waits for no viewer."""

from __future__ import annotations

import asyncio
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from bscd.api.security import StreamViewer, TheDaemon
from bscd.daemon.daemon import Daemon
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.latest import LatestFrames

router = APIRouter(tags=["camera"])

Role = Literal["primary", "auxiliary"]
Width = Annotated[int, Query(ge=64, le=8192, description="largest width, px")]

_LOOK_S = 0.02
_BOUNDARY = "frame"

#: A viewer that takes no more is let go after so long.
_STALLED_S = 10.0


def _require(daemon: Daemon, role: Role) -> None:
    if role not in daemon.bench.rig.cameras:
        raise UnknownNameError(f"camera {role}: the rig has none")


@router.get(
    "/camera/{role}/snapshot.jpg",
    response_class=Response,
    responses={200: {"description": "the newest frame", "content": {"image/jpeg": {}}}},
)
async def snapshot(daemon: TheDaemon, who: StreamViewer, role: Role, width: Width = 1280) -> Response:
    """The newest frame; X-Frame-Id and X-Frame-Age-S say which, and how old it is."""
    _require(daemon, role)
    found = await run_in_threadpool(daemon.latest.jpeg, role, width)
    if found is None:
        raise UnknownNameError(f"camera {role}: has taken no frame yet; ask again, or run a recipe")
    image, frame = found
    headers = {"X-Frame-Id": str(frame.frame_id), "X-Frame-Age-S": f"{frame.age_s:.3f}", "Cache-Control": "no-store"}
    return Response(image, media_type="image/jpeg", headers=headers)


@router.get(
    "/camera/{role}/stream.mjpg",
    response_class=Response,
    responses={200: {"description": "frames until the viewer leaves", "content": {"multipart/x-mixed-replace": {}}}},
)
async def stream(
    request: Request,
    daemon: TheDaemon,
    who: StreamViewer,
    role: Role,
    width: Width = 1280,
    fps: Annotated[float, Query(gt=0.0, le=60.0, description="frames a second, at most")] = 12.0,
) -> Response:
    """The newest frame each time there is one."""
    _require(daemon, role)
    return _Mjpeg(daemon.latest, role, width, 1.0 / fps, request.app.state.closing)


class _Mjpeg(Response):
    """Sends one part at a time, always the newest; a viewer that stalls holds that one part and is let go."""

    def __init__(self, latest: LatestFrames, role: str, width: int, period_s: float, closing: asyncio.Event) -> None:
        super().__init__(media_type=f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
        self._latest, self._role, self._width = latest, role, width
        self._period_s, self._closing = period_s, closing
        self.raw_headers = [(name, value) for name, value in self.raw_headers if name != b"content-length"]
        self.headers["Cache-Control"] = "no-store"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the viewer leaves, stalls, or the daemon ends."""
        await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
        left = asyncio.create_task(_left(receive))
        try:
            await self._send_frames(left, send)
        except (TimeoutError, OSError):
            return
        finally:
            left.cancel()

    async def _send_frames(self, left: asyncio.Task[None], send: Send) -> None:
        shown, loop = 0, asyncio.get_running_loop()
        due_s = loop.time()
        while not (left.done() or self._closing.is_set()):
            frame = self._latest.get(self._role)
            if frame is None or frame.number <= shown or loop.time() < due_s:
                await asyncio.sleep(_LOOK_S)
                continue
            coded = await run_in_threadpool(self._latest.jpeg, self._role, self._width)
            if coded is None:
                continue
            image, frame = coded
            shown, due_s = frame.number, max(due_s + self._period_s, loop.time())
            part = (
                f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n"
                f"X-Frame-Id: {frame.frame_id}\r\nX-Frame-Age-S: {frame.age_s:.3f}\r\n\r\n"
            )
            body = {"type": "http.response.body", "body": part.encode() + image + b"\r\n", "more_body": True}
            await asyncio.wait_for(send(body), _STALLED_S)
        if not left.done():
            await asyncio.wait_for(send({"type": "http.response.body", "body": f"--{_BOUNDARY}--\r\n".encode()}), 1.0)


async def _left(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
