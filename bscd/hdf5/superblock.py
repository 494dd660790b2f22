"""The first bytes of an HDF5 file: whether a writer left it open, and how that mark is cleared.

HDF5 file format specification, section II.A (superblock versions 2 and 3). What is done here is what ``h5clear
--status --increment=0`` does: two fields of the superblock and its checksum, no byte of data.
"""

from __future__ import annotations

import io
import os
import struct
from pathlib import Path
from typing import Any

SIGNATURE = b"\x89HDF\r\n\x1a\n"
VERSION, FLAGS = 8, 11
OPEN_FOR_WRITE = 1

_END_OF_FILE, _CHECKSUM = 28, 44
_SIZE = 48
_MASK = 0xFFFFFFFF


def clear_open_mark(path: Path) -> bool:
    """Clear the mark of a writer that was killed, so that any program can open the file; False when there is none.

    The file's end as HDF5 keeps it is set to its size, since what was written last may lie beyond. Raises `OSError`
    when the file can not be written and `ValueError` when its superblock is damaged or of another version.
    """
    with path.open("r+b") as file:
        head = file.read(_SIZE)
        cleared = _cleared(head, os.fstat(file.fileno()).st_size)
        if cleared == head:
            return False
        file.seek(0)
        file.write(cleared)
        file.flush()
        os.fsync(file.fileno())
    return True


def require_whole(head: bytes) -> None:
    """Raise `ValueError` when the superblock (its first bytes, 48 or more) does not match its checksum.

    HDF5 itself does not give up on one in SWMR mode: it waits for a writer to set it right.
    """
    if len(head) < _SIZE or head[9:11] != b"\x08\x08":
        raise ValueError("its first bytes are not those of a file that was written so")
    if struct.unpack_from("<I", head, _CHECKSUM)[0] != lookup3(head[:_CHECKSUM]):
        raise ValueError("its first bytes do not match their checksum")


def _cleared(head: bytes, size: int) -> bytes:
    """A superblock without the mark of a writer."""
    if head[VERSION : VERSION + 1] != b"\x03":
        raise ValueError("its first bytes are not those of a file that was written so")
    require_whole(head)
    if not head[FLAGS]:
        return head
    cleared = bytearray(head)
    cleared[FLAGS] = 0
    end = struct.unpack_from("<Q", head, _END_OF_FILE)[0]
    struct.pack_into("<Q", cleared, _END_OF_FILE, max(end, size))
    struct.pack_into("<I", cleared, _CHECKSUM, lookup3(bytes(cleared[:_CHECKSUM])))
    return bytes(cleared)


def missing_bytes(path: Path) -> int:
    """How many bytes of a file's end are not there, since it was cut off.

    Raises `OSError` when it can not be read and `ValueError` when its superblock is damaged or of another version.
    """
    with path.open("rb") as file:
        head = file.read(_SIZE)
        _cleared(head, 0)  # whether it is one of ours
        return max(struct.unpack_from("<Q", head, _END_OF_FILE)[0] - os.fstat(file.fileno()).st_size, 0)


class ClearedFile(io.RawIOBase):
    """A file as `clear_open_mark` would leave it, to be read; the file itself is not changed.

    So HDF5 reads what a crash left without SWMR, and tells damage instead of waiting for a writer to repair it. A file
    that was cut off has its old length; what is not there reads as bytes 0xFF: -1, NaN and no text.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb", buffering=0)
        try:
            size = os.fstat(self._file.fileno()).st_size
            self._head = _cleared(self._file.read(_SIZE), size)
            self._length = max(struct.unpack_from("<Q", self._head, _END_OF_FILE)[0], size)
        except BaseException:
            self._file.close()
            raise

    def readinto(self, buffer: Any, /) -> int:
        """Fill the buffer from where the file stands; how many bytes there were."""
        view, start, count = memoryview(buffer).cast("B"), self._file.tell(), 0
        while count < len(view) and (got := self._file.readinto(view[count:])):
            count += got
        replaced = self._head[start : start + count] if start < _SIZE else b""
        view[: len(replaced)] = replaced
        length = max(min(len(view), self._length - start), count)
        view[count:length] = b"\xff" * (length - count)
        self._file.seek(start + length)
        return length

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        """Go to a place in the file."""
        if whence == os.SEEK_END:
            offset, whence = self._length + offset, os.SEEK_SET
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Where the file stands."""
        return self._file.tell()

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._file.close()
        super().close()


def lookup3(data: bytes) -> int:
    """HDF5's checksum of metadata: Bob Jenkins' lookup3, ``hashlittle`` with the initial value 0."""
    a = b = c = (0xDEADBEEF + len(data)) & _MASK
    blocks = max(0, (len(data) - 1) // 12)
    for start in range(0, 12 * blocks, 12):
        x, y, z = struct.unpack_from("<3I", data, start)
        a, b, c = _mix((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)
    rest = data[12 * blocks :]
    if not rest:
        return c
    x, y, z = struct.unpack("<3I", rest.ljust(12, b"\0"))
    return _final((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)


def _rotate(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK


def _mix(a: int, b: int, c: int) -> tuple[int, int, int]:
    for bits in (4, 6, 8, 16, 19, 4):
        a = ((a - c) & _MASK) ^ _rotate(c, bits)
        c = (c + b) & _MASK
        a, b, c = b, c, a
    return a, b, c


def _final(a: int, b: int, c: int) -> int:
    for bits in (14, 11, 25, 16, 4, 14, 24):
        c = ((c ^ b) - _rotate(b, bits)) & _MASK
        a, b, c = b, c, a
    # seven turns of three names leave the last word computed, c, in b
    return b
