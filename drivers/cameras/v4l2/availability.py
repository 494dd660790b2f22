"""Whether a V4L2 device is there and free, asked of the kernel: OpenCV says no without a reason, and logs it itself.

Requests and structures: ``linux/videodev2.h`` (64 bit). Errors: the V4L2 API's open() and VIDIOC_S_FMT.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct

VIDIOC_QUERYCAP, VIDIOC_G_FMT, VIDIOC_S_FMT = 0x80685600, 0xC0D05604, 0xC0D05605
CAPABILITY_BYTES, DEVICE_CAPS_AT, FORMAT_BYTES = 104, 88, 208
CAPTURE, CAPTURE_MULTIPLANE = 0x1, 0x1000
"""Capabilities, with the types of buffer 1 and 9."""


def require_free(path: str) -> None:
    """Raise `OSError` unless a camera can be had at ``path``; EBUSY where another program has it. Changes nothing.

    Many programs may open a device, but only one has its buffers; while it does, the kernel refuses even the format
    that is set already.
    """
    device = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        kind = _buffer_type(device)
        wanted = bytearray(FORMAT_BYTES)
        struct.pack_into("I", wanted, 0, kind)
        fcntl.ioctl(device, VIDIOC_G_FMT, wanted)
        fcntl.ioctl(device, VIDIOC_S_FMT, wanted)
    finally:
        os.close(device)


def _buffer_type(device: int) -> int:
    told = bytearray(CAPABILITY_BYTES)
    fcntl.ioctl(device, VIDIOC_QUERYCAP, told)
    (capabilities,) = struct.unpack_from("I", told, DEVICE_CAPS_AT)
    if capabilities & CAPTURE:
        return 1
    if capabilities & CAPTURE_MULTIPLANE:
        return 9
    raise OSError(errno.ENOTTY, "it gives no images")
