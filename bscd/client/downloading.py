"""A download that can go on where it was cut off: what both clients do with its pieces."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import httpx

from bscd.client.errors import NoDaemonError
from bscd.errors import BscdError

PIECE_BYTES = 1 << 20


class Download:
    """Into the new file ``to``; ``to``.part until it is whole. Raises `BscdError` when ``to`` exists."""

    def __init__(self, to: Path | str) -> None:
        self._path = Path(to)
        if self._path.exists():
            raise BscdError(f"{self._path}: exists already; nothing is overwritten, choose another name")
        self._part = self._path.with_name(self._path.name + ".part")

    @property
    def headers(self) -> dict[str, str]:
        """For what is not there yet."""
        have = self._part.stat().st_size if self._part.exists() else 0
        return {"Range": f"bytes={have}-"} if have else {}

    def opened(self, response: httpx.Response) -> BinaryIO:
        """Where the response's pieces are written."""
        return self._part.open("ab" if response.status_code == httpx.codes.PARTIAL_CONTENT else "wb")

    def is_whole(self, response: httpx.Response) -> bool:
        """Whether there is nothing more to come."""
        return response.status_code == httpx.codes.REQUESTED_RANGE_NOT_SATISFIABLE

    def ended(self) -> Path:
        """Give it its name."""
        self._part.rename(self._path)
        return self._path

    def cut_off(self, error: Exception) -> NoDaemonError:
        """That the line broke."""
        return NoDaemonError(f"{self._path}: the download was cut off ({error}); ask again and it goes on")
