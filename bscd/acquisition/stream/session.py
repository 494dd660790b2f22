"""A stream into a run file, from its first frame to its account: ring, recorder and followers."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

from bscd.acquisition.records import CameraMeta, FrameRecord, TimeBase
from bscd.acquisition.stream.follower import Follower
from bscd.acquisition.stream.losses import FrameAccount
from bscd.acquisition.stream.recorder import Recorder
from bscd.acquisition.stream.ring import FrameRing
from bscd.acquisition.writer import RunWriter
from bscd.errors import BscdError

RING_FULL = "the ring was full: the disk fell behind"

#: How long the disk may take for what waits in the ring when the stream has ended.
_LAST_FRAMES_S = 60.0


class StreamSession:
    """One camera's stream into a run; a context manager inside the writer's own.

    At its end the run holds the account: exposures = frames written + losses with their reasons. An account that does
    not close, and a recorder that failed, are raised as `BscdError`, so the run ends as interrupted.

    Parameters
    ----------
    writer
        An open run; nobody else uses it inside the block.
    camera
        The camera whose frames come.
    slots
        Frames that the ring holds.
    followers
        Who else takes frames.
    """

    def __init__(
        self, writer: RunWriter, camera: CameraMeta, *, slots: int = 64, followers: Sequence[Follower] = ()
    ) -> None:
        self._writer = writer
        self._followers = followers
        self._begun: list[Follower] = []
        self.account = FrameAccount()
        self.ring = FrameRing((camera.height_px, camera.width_px), camera.dtype, slots)
        self.recorder = Recorder(writer, self.ring, self.account)
        self.time_base: TimeBase | None = None
        self._before = writer.frames_written

    @property
    def written(self) -> int:
        """Frames of this stream in the file."""
        return self._writer.frames_written - self._before

    def publish(self, number: int, record: FrameRecord, reason: str) -> None:
        """Take in an exposure's frame; ``reason`` is why those since the one before did not come, if any."""
        missing = self.account.exposed(number, reason)
        if missing:
            self.recorder.event(f"{_frames(missing)} lost before frame id {record.frame_id}: {reason}")
        if not self.ring.publish(number, record):
            self.account.lose(number, RING_FULL)

    def ended(self, count: int, reason: str) -> None:
        """No more frames of ``count`` exposures will come."""
        missing = self.account.ended(count, reason)
        if missing:
            self.recorder.event(f"{_frames(missing)} lost at the end: {reason}")

    def require_writing(self) -> None:
        """Raise the recorder's failure, if there is one."""
        if self.recorder.failure is not None:
            raise self.recorder.failure

    def __enter__(self) -> StreamSession:
        """Begin the followers and the recorder."""
        try:
            for follower in self._followers:
                follower.begin(self.ring)
                self._begun.append(follower)
            self.recorder.start()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write what waits, end the followers, keep the account."""
        try:
            self.recorder.finish(_LAST_FRAMES_S)
        finally:
            told = self._close()
        if self._writer.is_open:
            for text in told:
                self._writer.event(text)
            self._writer.account(self.account.acquired, self.account.losses)
            if self.time_base is not None:
                self._writer.state_time_base(self.time_base)
        if error is None:
            self.require_writing()
            if why := self.account.difference(self.written):
                raise BscdError(f"{self._writer.path}: the run is incomplete, {why}")

    def _close(self) -> list[str]:
        """End the followers and free the ring; what went wrong with them."""
        self.ring.end()
        told: list[str] = []
        for follower in self._begun:
            try:
                follower.end()
            except Exception as error:  # it only follows; the recording is whole without it
                told.append(f"{follower.name} ended badly: {error}")
        self._begun = []
        self.ring.close()
        return told


def _frames(count: int) -> str:
    return f"{count} frame{'s' * (count > 1)}"
