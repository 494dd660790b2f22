"""Who else follows a recording while it goes on: the correlator, a page that shows it."""

from __future__ import annotations

from typing import Protocol

from bscd.acquisition.stream.ring import FrameRing


class Follower(Protocol):
    """Takes frames of a recording's ring; it may fall behind and never holds the recording up."""

    name: str

    def begin(self, ring: FrameRing) -> None:
        """Subscribe and start; called once, before the first frame. What it raises refuses the recording."""
        ...

    def end(self) -> None:
        """Stop and join, within a time of its own; called once, when the ring has ended and the membrane is vented.

        Frames that still wait may be taken or left; those left out are in the file. What it raises becomes an event.
        """
        ...
