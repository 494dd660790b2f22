"""From a camera to its consumers: the ring, the recorder, the live view, and the account of every exposure."""

from bscd.acquisition.stream.follower import Follower
from bscd.acquisition.stream.live_view import LiveView
from bscd.acquisition.stream.losses import FrameAccount
from bscd.acquisition.stream.recorder import Recorder
from bscd.acquisition.stream.ring import FrameRing
from bscd.acquisition.stream.session import StreamSession
from bscd.acquisition.stream.subscription import ConsumerCounts, FrameLease, Keep, Subscription

__all__ = [
    "ConsumerCounts",
    "Follower",
    "FrameAccount",
    "FrameLease",
    "FrameRing",
    "Keep",
    "LiveView",
    "Recorder",
    "StreamSession",
    "Subscription",
]
