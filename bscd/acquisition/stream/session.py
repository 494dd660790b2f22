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
        self._behind = False
        self._refused = 0
        self._refused_at = ""

    @property
    def written(self) -> int:
        """Frames of this stream in the file."""
        return self._writer.frames_written - self._before

    def publish(self, number: int, record: FrameRecord, reason: str) -> None:
        """Take in an exposure's frame; ``reason`` is why those since the one before did not come, if any."""
        missing = self.account.exposed(number, reason)
        if missing:
            self.recorder.event(f"{_frames(missing)} lost before frame id {record.frame_id}: {reason}")
        if self.ring.publish(number, record):
            self._tell_refused(f"before frame id {record.frame_id}")
        else:
            self.account.lose(number, RING_FULL)
            self._refused_at = self._refused_at or self._writer.time_text()
            self._refused += 1
        self._watch_ring()

    def ended(self, count: int, reason: str) -> None:
        """No more frames of ``count`` exposures will come."""
        missing = self.account.ended(count, reason)
        if missing:
            self.recorder.event(f"{_frames(missing)} lost at the end: {reason}")

    @property
    def trouble(self) -> str:
        """What whoever follows the recording should know now, a few words; empty when all is well."""
        told = []
        if self._behind:
            told.append(f"the disk falls behind, {self.ring.fill} of {self.ring.slots} buffers in use")
        if lost := self.account.lost:
            told.append(f"{_frames(lost)} lost")
        return ", ".join(told)

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
        self._tell_refused("at the end")
        try:
            self.recorder.finish(_LAST_FRAMES_S)
        finally:
            told = self._close()
        if self._behind and self.recorder.failure is None:
            told.append("the disk has caught up")
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

    def _watch_ring(self) -> None:
        """Raise and end the alarm of a ring that fills up, with an event each; here, since the recorder may hang."""
        fill, slots = self.ring.fill, self.ring.slots
        if self.ring.filling_up and not self._behind:
            self._behind = True
            self.recorder.event(f"the disk falls behind: {fill} of {slots} buffers in use")
        elif self._behind and fill <= slots // 4:
            self._behind = False
            self.recorder.event("the disk has caught up")

    def _tell_refused(self, where: str) -> None:
        """Keep an event of the frames that found no buffer, with the time of the first."""
        if self._refused:
            self.recorder.event(f"{_frames(self._refused)} lost {where}: {RING_FULL}", self._refused_at)
            self._refused, self._refused_at = 0, ""

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
