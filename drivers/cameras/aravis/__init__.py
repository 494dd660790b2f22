"""GigE Vision and USB3 Vision cameras through Aravis; can be imported, and its options read, without Aravis."""

from drivers.cameras.aravis.camera import AravisCamera
from drivers.cameras.aravis.counters import FrameGap, StreamCounters
from drivers.cameras.aravis.options import AravisOptions

__all__ = ["AravisCamera", "AravisOptions", "FrameGap", "StreamCounters"]
