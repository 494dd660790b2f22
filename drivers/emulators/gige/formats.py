"""Pixel formats of the emulated camera, as GenICam names and codes them (PFNC), and their bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

MONO8 = 0x01080001
CODES = {
    "Mono8": MONO8,
    "Mono10": 0x01100003,
    "Mono10Packed": 0x010C0004,
    "Mono10p": 0x010A0046,
    "Mono12": 0x01100005,
    "Mono12Packed": 0x010C0006,
    "Mono12p": 0x010C0047,
}
_BITS = {code: int("".join(filter(str.isdigit, name))) for name, code in CODES.items()}
_NAMES = {code: name for name, code in CODES.items()}


def offered(sensor_bits: int) -> dict[str, int]:
    """The formats of a sensor of so many bits: its own depth, and 8 bits."""
    return {name: code for name, code in CODES.items() if _BITS[code] in (8, sensor_bits)}


def encode(image: NDArray[Any], sensor_bits: int, code: int) -> bytes:
    """The bytes of an image on the wire; its low bits go where the format has fewer than the sensor."""
    pixels = (image >> max(sensor_bits - _BITS[code], 0)).astype(np.uint16)
    name, bits = _NAMES[code], _BITS[code]
    if bits == 8:
        return pixels.astype(np.uint8).tobytes()
    if name.endswith("Packed"):
        return _gige_packed(pixels, bits)
    if name.endswith("p"):
        # PFNC: a stream of bits, the lowest of each pixel first
        stream = np.unpackbits(pixels.astype("<u2").view(np.uint8).reshape(-1, 2), axis=1, bitorder="little")
        return np.packbits(stream[:, :bits].ravel(), bitorder="little").tobytes()
    return pixels.astype("<u2").tobytes()


def _gige_packed(pixels: NDArray[np.uint16], bits: int) -> bytes:
    """GigE Vision 1.x: two pixels in three bytes, high bytes outside, the low bits share the middle one."""
    first, second = pixels.ravel()[0::2], pixels.ravel()[1::2]
    low = bits - 8
    packed = np.empty((first.size, 3), np.uint8)
    packed[:, 0] = first >> low
    packed[:, 1] = (first & ((1 << low) - 1)) | ((second & ((1 << low) - 1)) << 4)
    packed[:, 2] = second >> low
    return packed.tobytes()
