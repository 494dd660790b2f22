"""Bytes of a GenICam pixel format -> grey levels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8] | NDArray[np.uint16]


def bit_depth(pixel_format: str) -> int:
    """Bits of a pixel of a monochrome format: 12 for "Mono12Packed"."""
    return int("".join(filter(str.isdigit, pixel_format)))


def frame_bytes(pixel_format: str, width_px: int, height_px: int) -> int:
    """Bytes of an image on the wire; packed formats fill whole groups of pixels."""
    pixels = width_px * height_px
    if pixel_format in _PACKED:
        group_bytes, group_pixels, _ = _PACKED[pixel_format]
        return -(-pixels * group_bytes // group_pixels)
    return pixels * (1 if bit_depth(pixel_format) == 8 else 2)


def unpack(data: bytes, pixel_format: str, width_px: int, height_px: int) -> Grey:
    """Grey levels ``(height, width)``, read-only: uint8 for 8 bits, else uint16 of the format's own range.

    ``data`` must be `frame_bytes` long. Formats are those of the PFNC: ``Packed`` as in GigE Vision 1.x, ``p`` a
    stream of bits with the lowest bit of each pixel first, the others in 16 bits, little end first.
    """
    pixels = width_px * height_px
    raw = np.frombuffer(data, np.uint8)
    if pixel_format in _PACKED:
        group_bytes, _, spread = _PACKED[pixel_format]
        if raw.size % group_bytes:
            raw = np.pad(raw, (0, group_bytes - raw.size % group_bytes))
        image: NDArray[Any] = spread(raw.reshape(-1, group_bytes).astype(np.uint16)).reshape(-1)[:pixels]
    elif bit_depth(pixel_format) == 8:
        image = raw
    else:
        image = raw.view("<u2").astype(np.uint16, copy=False)
    image = image.reshape(height_px, width_px)
    image.setflags(write=False)
    return image


def _spread_12_packed(b: NDArray[Any]) -> NDArray[Any]:
    return np.stack([b[:, 0] << 4 | b[:, 1] & 0x0F, b[:, 2] << 4 | b[:, 1] >> 4], axis=1)


def _spread_10_packed(b: NDArray[Any]) -> NDArray[Any]:
    return np.stack([b[:, 0] << 2 | b[:, 1] & 0x03, b[:, 2] << 2 | b[:, 1] >> 4 & 0x03], axis=1)


def _spread_12p(b: NDArray[Any]) -> NDArray[Any]:
    return np.stack([b[:, 0] | (b[:, 1] & 0x0F) << 8, b[:, 1] >> 4 | b[:, 2] << 4], axis=1)


def _spread_10p(b: NDArray[Any]) -> NDArray[Any]:
    return np.stack(
        [
            b[:, 0] | (b[:, 1] & 0x03) << 8,
            b[:, 1] >> 2 | (b[:, 2] & 0x0F) << 6,
            b[:, 2] >> 4 | (b[:, 3] & 0x3F) << 4,
            b[:, 3] >> 6 | b[:, 4] << 2,
        ],
        axis=1,
    )


#: Bytes of a group, pixels in it, and how they are spread.
_PACKED: dict[str, tuple[int, int, Callable[[NDArray[Any]], NDArray[Any]]]] = {
    "Mono12Packed": (3, 2, _spread_12_packed),
    "Mono10Packed": (3, 2, _spread_10_packed),
    "Mono12p": (3, 2, _spread_12p),
    "Mono10p": (5, 4, _spread_10p),
}
