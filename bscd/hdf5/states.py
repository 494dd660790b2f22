"""Where a file that is written while it can be read is in its life."""

from __future__ import annotations

from enum import StrEnum


class FileState(StrEnum):
    """What a file says of its own writing."""

    RECORDING = "recording"
    """Being written now, or cut off by a crash."""
    COMPLETE = "complete"
    """Closed at its end; never changed again."""
    INTERRUPTED = "interrupted"
    """Closed early, with a reason."""
