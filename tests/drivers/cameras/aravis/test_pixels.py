"""Pixel formats: bytes written out by hand from the PFNC, and every value of the format."""

import numpy as np
import pytest

from drivers.cameras.aravis.pixels import bit_depth, frame_bytes, unpack

# two (or four) pixels and their bytes, from the figures of the GenICam Pixel Format Naming Convention
BY_HAND = [
    ("Mono8", [0x12, 0xFE], "12fe"),
    ("Mono10", [0x3FE, 0x001], "fe030100"),
    ("Mono12", [0xABC, 0x123], "bc0a2301"),
    ("Mono12Packed", [0xABC, 0x123], "ab3c12"),
    ("Mono10Packed", [0b1111111101, 0b0000000110], "ff2101"),
    ("Mono12p", [0xABC, 0x123], "bc3a12"),
    ("Mono10p", [0x3FF, 0x000, 0x3FF, 0x000], "ff03f03f00"),
    ("Mono10p", [0x001, 0x002, 0x003, 0x004], "0108300001"),
]


@pytest.mark.parametrize(("pixel_format", "pixels", "written"), BY_HAND)
def test_bytes_are_read_as_the_convention_says(pixel_format, pixels, written):
    data = bytes.fromhex(written)
    assert frame_bytes(pixel_format, len(pixels), 1) == len(data)
    image = unpack(data, pixel_format, len(pixels), 1)
    assert image.tolist() == [pixels]
    assert image.dtype == (np.uint8 if pixel_format == "Mono8" else np.uint16)
    assert not image.flags.writeable


@pytest.mark.parametrize(
    ("pixel_format", "group"), [("Mono12Packed", 2), ("Mono10Packed", 2), ("Mono12p", 2), ("Mono10p", 4)]
)
def test_an_image_may_end_within_a_group(pixel_format, group):
    size = frame_bytes(pixel_format, 3, 3)
    image = unpack(bytes(size), pixel_format, 3, 3)
    assert image.shape == (3, 3)
    assert 9 % group and not image.any()


def test_depths():
    names = ["Mono8", "Mono10", "Mono10Packed", "Mono10p", "Mono12", "Mono12Packed", "Mono12p"]
    assert [bit_depth(name) for name in names] == [8, 10, 10, 10, 12, 12, 12]
