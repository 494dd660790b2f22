"""The emulated camera's bytes, against the figures of the GenICam Pixel Format Naming Convention."""

import numpy as np
import pytest

from drivers.emulators.gige.exposures import Readout
from drivers.emulators.gige.formats import CODES, MONO8, encode, offered


@pytest.mark.parametrize(
    ("name", "bits", "pixels", "written"),
    [
        ("Mono8", 8, [0x12, 0xFE], "12fe"),
        ("Mono8", 12, [0x123, 0xFEF], "12fe"),
        ("Mono10", 10, [0x3FE, 0x001], "fe030100"),
        ("Mono12", 12, [0xABC, 0x123], "bc0a2301"),
        ("Mono12Packed", 12, [0xABC, 0x123], "ab3c12"),
        ("Mono10Packed", 10, [0b1111111101, 0b0000000110], "ff2101"),
        ("Mono12p", 12, [0xABC, 0x123], "bc3a12"),
        ("Mono10p", 10, [0x001, 0x002, 0x003, 0x004], "0108300001"),
    ],
)
def test_pixels_are_written_as_the_convention_says(name, bits, pixels, written):
    image = np.array([pixels], np.uint8 if bits == 8 else np.uint16)
    data = encode(image, bits, CODES[name])
    assert data.hex() == written
    # the code carries the bits a pixel takes on the wire, by which clients size their buffers
    assert len(data) * 8 == len(pixels) * (CODES[name] >> 16 & 0xFF)


@pytest.mark.parametrize(
    ("bits", "names"),
    [
        (8, ["Mono8"]),
        (10, ["Mono8", "Mono10", "Mono10Packed", "Mono10p"]),
        (12, ["Mono8", "Mono12", "Mono12Packed", "Mono12p"]),
    ],
)
def test_a_sensor_offers_its_own_depth_and_eight_bits(bits, names):
    assert list(offered(bits)) == names


def readout(**changes):
    values = {"exposure_s": 0.01, "gain_db": 0.0, "x_px": 0, "y_px": 0, "width_px": 6, "height_px": 4}
    return Readout(**{**values, "binning": (1, 1), "pixel_format": MONO8, **changes})


def test_a_region_is_cut_and_bins_are_averaged():
    image = np.arange(24, dtype=np.uint8).reshape(4, 6)
    part = readout(x_px=2, y_px=1, width_px=2, height_px=2)
    assert list(part.content(image, 8)) == [8, 9, 14, 15]
    binned = readout(width_px=3, height_px=2, binning=(2, 2))
    assert list(binned.content(image, 8)) == [4, 6, 8, 16, 18, 20]  # 3.5 and 5.5 are rounded to even


def test_what_lies_outside_the_sensor_is_black():
    image = np.full((4, 6), 9, np.uint8)
    assert list(readout(x_px=5, width_px=2, height_px=1).content(image, 8)) == [9, 0]
