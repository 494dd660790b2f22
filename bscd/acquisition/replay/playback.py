"""Goes through a recording: the frame that comes next, its number and when it is due."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bscd.acquisition.replay.recordings import RecordedImage, Recording


@dataclass(frozen=True, slots=True)
class Step:
    """One image, the count of its exposure, and the time from the exposure before it, in s."""

    image: RecordedImage
    frame_id: int
    missing: int
    after_s: float


class Playback:
    """Steps through a recording, once or again and again; not safe to use from two threads at once.

    Parameters
    ----------
    recording : Recording
        What is played.
    repeat : bool
        Whether the first image follows the last one.
    period_s : callable
        How long between two images; None: as they were recorded.
    """

    def __init__(self, recording: Recording, repeat: bool, period_s: Callable[[], float | None]) -> None:
        self._recording = recording
        self._repeat = repeat
        self._period_s = period_s
        self._images = recording.images()
        self._last: RecordedImage | None = None
        self._frame_id = -1
        self._interval_s = 0.0

    def next(self) -> Step | None:
        """The next step; None at the end. Raises `InputError` for an image that can not be read."""
        image = next(self._images, None)
        if image is None and self._repeat:
            self._images, self._last = self._recording.images(), None
            image = next(self._images, None)
        if image is None:
            return None
        steps = 1
        if self._last is not None:
            steps = max(image.frame_id - self._last.frame_id, 1)
            self._interval_s = max(image.time_s - self._last.time_s, 0.0)
        self._frame_id += steps
        self._last = image
        period_s = self._period_s()
        after_s = self._interval_s if period_s is None else steps * period_s
        return Step(image, self._frame_id, steps - 1, after_s)
