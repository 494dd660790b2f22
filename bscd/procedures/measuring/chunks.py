"""The work of a pool: track one view through a chunk of frames, from where its tracker stood before."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bscd.dic import PreparedImage
from bscd.dic.pool import LentImage
from bscd.dic.tracker_state import Tracked, TrackerState
from bscd.dic.tracking import Tracker, TrackingSettings
from bscd.procedures.measuring.overlap import plain_linear_algebra
from bscd.procedures.measuring.views import Side, ViewSource

LentFrame = tuple[LentImage, ...]
"""A frame's images where a worker can read them."""

#: Trackers that a worker keeps: with their images, some 50 MB each.
_KEPT = 4

_lock = threading.Lock()
_trackers: OrderedDict[str, Tracker] = OrderedDict()


@dataclass(frozen=True, eq=False)
class Chain:
    """What all chunks of one view of a sequence have in common; ``name`` is like no other chain's."""

    name: str
    side: Side
    source: ViewSource
    settings: TrackingSettings


@dataclass(frozen=True, eq=False)
class Resume:
    """What a worker needs that has not tracked the chunk before: the state, and its images by their numbers."""

    state: TrackerState
    images: Mapping[int, LentFrame]


def track_chunk(
    chain: Chain, tracked: int, frames: Sequence[LentFrame], resume: Resume | None
) -> tuple[list[Tracked], TrackerState] | None:
    """Where the points are in the frames that follow the ``tracked`` ones before, and the state after them.

    None when this worker did not track those and is not told how to go on: ask again with ``resume``.
    """
    with plain_linear_algebra():
        tracker = _kept(chain, tracked) or _resumed(chain, resume)
        if tracker is None:
            return None
        found = [tracker.track(_view(chain, frame)) for frame in frames]
        with _lock:
            _trackers[chain.name] = tracker
            while len(_trackers) > _KEPT:
                _trackers.popitem(last=False)
        return found, tracker.state()


def load() -> None:
    """Have a worker load what `track_chunk` needs, by asking it for something of this module."""


def _kept(chain: Chain, tracked: int) -> Tracker | None:
    """The tracker that did the chunk before, taken out so that no one else goes on with it."""
    with _lock:
        tracker = _trackers.pop(chain.name, None)
    return tracker if tracker is not None and tracker.tracked == tracked else None


def _resumed(chain: Chain, resume: Resume | None) -> Tracker | None:
    if resume is None:
        return None
    images = {number: _view(chain, frame) for number, frame in resume.images.items()}
    return Tracker.resumed(resume.state, images, chain.settings)


def _view(chain: Chain, frame: LentFrame) -> PreparedImage:
    return chain.source.view(chain.side, tuple(image.read() for image in frame))
