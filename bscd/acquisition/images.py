"""Read one image file as grey levels, without a silent change of its pixels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bscd.errors import InputError

SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".pgm")

_PNG_SIGNATURE, _PNG_END = b"\x89PNG", b"IEND"


@dataclass(frozen=True, slots=True)
class GreyImage:
    """Grey levels ``(height, width)`` uint8 or uint16, and whether they were made from a colour image."""

    data: NDArray[np.uint8] | NDArray[np.uint16]
    from_colour: bool


def read_grey(path: Path) -> GreyImage:
    """Read PNG, TIFF, BMP, JPEG or PGM, 8 or 16 bit; colour becomes luma (Rec. 601: 0.299 R + 0.587 G + 0.114 B).

    Raises `InputError` whose text says why not, without the file's name.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"is not one of {', '.join(suffix[1:] for suffix in SUFFIXES)}")
    try:
        content = path.read_bytes()
    except OSError as err:
        raise InputError(f"can not be read ({err.strerror})") from err
    pixels = _decode(content, is_tiff=path.suffix.lower().startswith(".tif"))
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"has {pixels.dtype} pixels; allowed: 8 or 16 bit unsigned")
    if pixels.ndim == 2:
        return GreyImage(pixels, from_colour=False)
    if pixels.shape[2] not in (3, 4):
        raise InputError(f"has {pixels.shape[2]} channels; allowed: grey or colour")
    colour = np.ascontiguousarray(pixels[:, :, :3])
    grey: NDArray[Any] = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    return GreyImage(grey, from_colour=True)


def _decode(content: bytes, is_tiff: bool) -> NDArray[Any]:
    if not content:
        raise InputError("is an empty file; copy it again")
    broken = InputError("is not an image or is damaged; open it in a viewer, copy or save it again")
    if content.startswith(_PNG_SIGNATURE) and _PNG_END not in content[-64:]:
        raise broken
    encoded = np.frombuffer(content, np.uint8)
    with _quiet_opencv():
        try:
            pixels = cv2.imdecode(encoded, cv2.IMREAD_UNCHANGED)
            pages = len(cv2.imdecodemulti(encoded, cv2.IMREAD_UNCHANGED)[1]) if is_tiff else 1
        except cv2.error as err:
            raise broken from err
    if pixels is None:
        raise broken
    if pages > 1:
        raise InputError(f"holds {pages} images; save each as a file of its own")
    return pixels


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """OpenCV explains broken files on stderr; what the user is told is ours."""
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
