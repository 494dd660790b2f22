"""Which daemon a command talks to, and with which key; keys are never given on the command line, others see that."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from bscd.client import DEFAULT_URL, Client
from bscd.errors import InputError

#: Where a key lies that is not in the environment.
KEY_FILE = Path("~/.config/bscd/key")

Url = Annotated[str, typer.Option(envvar="BSCD_URL", help="The daemon's address.")]
URL = DEFAULT_URL


def client_at(url: str) -> Client:
    """A client with the key of BSCD_KEY, or of the file that BSCD_KEY_FILE names, or of ~/.config/bscd/key.

    Raises `InputError` for a key file that others may read.
    """
    return Client(url, key=_key(), operator=os.environ.get("USER") or None, estop_url=os.environ.get("BSCD_ESTOP_URL"))


def _key() -> str | None:
    if key := os.environ.get("BSCD_KEY", "").strip():
        return key
    named = os.environ.get("BSCD_KEY_FILE")
    path = Path(named) if named else KEY_FILE.expanduser()
    if not path.exists():
        if named:
            raise InputError(f"{path}: there is no such key file; correct BSCD_KEY_FILE")
        return None
    if path.stat().st_mode & 0o077:
        raise InputError(f"{path}: others may read this key; chmod 600 {path}")
    return path.read_text(encoding="utf-8").strip() or None
