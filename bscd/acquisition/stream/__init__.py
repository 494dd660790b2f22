"""From a camera to its consumers: the ring, the recorder, the live view, and the account of every exposure."""

from bscd.acquisition.stream.live_view import LiveView
from bscd.acquisition.stream.losses import FrameAccount
from bscd.acquisition.stream.recorder import Recorder
from bscd.acquisition.stream.ring import FrameRing
from bscd.acquisition.stream.subscription import ConsumerCounts, FrameLease, Keep, Subscription

__all__ = ["ConsumerCounts", "FrameAccount", "FrameLease", "FrameRing", "Keep", "LiveView", "Recorder", "Subscription"]
