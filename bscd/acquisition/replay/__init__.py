"""A folder of images or a recorded run as a camera."""

from bscd.acquisition.replay.camera import ReplayCamera
from bscd.acquisition.replay.options import ReplayOptions
from bscd.acquisition.replay.recordings import FolderRecording, RecordedImage, Recording, RunRecording, open_recording

__all__ = [
    "FolderRecording",
    "RecordedImage",
    "Recording",
    "ReplayCamera",
    "ReplayOptions",
    "RunRecording",
    "open_recording",
]
