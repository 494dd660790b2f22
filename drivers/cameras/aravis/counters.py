"""What became of every frame and packet, stage by stage."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class StreamCounters:
    """Counts since `Camera.start`, from the wire to the reader.

    ``completed``, ``failed``, ``underrun``, ``missing_packets`` and ``resent_packets`` are Aravis's own: frames that
    came whole, frames that did not, frames for which it had no buffer, packets that never came, packets that came
    when they were asked for again. ``incomplete`` are frames that came with packets missing, ``missing`` the jumps of
    the frame id that these do not explain, ``overrun`` the frames for which the reader was too late, ``delivered``
    those that were read.
    """

    completed: int = 0
    failed: int = 0
    underrun: int = 0
    missing_packets: int = 0
    resent_packets: int = 0
    incomplete: int = 0
    missing: int = 0
    overrun: int = 0
    delivered: int = 0

    def __add__(self, other: StreamCounters) -> StreamCounters:
        """Both together."""
        return StreamCounters(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True, slots=True)
class FrameGap:
    """A time without a camera during a stream: ``missing`` frames, by the frame rate, before ``frame_id``."""

    frame_id: int
    missing: int
    duration_s: float
