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


def client_at(url: str, *, stops: bool = False) -> Client:
    """A client with the key of BSCD_KEY, or of the file that BSCD_KEY_FILE names, or of ~/.config/bscd/key.

    Raises `InputError` for a key file that can not be used; one that ``stops`` everything goes without that key, it may
    need none.
    """
    try:
        key = _key()
    except InputError as error:
        if not stops:
            raise
        typer.echo(f"warning: {error}", err=True)
        key = None
    operator, estop_url = os.environ.get("USER"), os.environ.get("BSCD_ESTOP_URL")
    return Client(url, key=key, operator=operator or None, estop_url=estop_url or None)


def _key() -> str | None:
    if key := os.environ.get("BSCD_KEY", "").strip():
        return key
    named = os.environ.get("BSCD_KEY_FILE")
    path = Path(named) if named else Path(os.path.expanduser(KEY_FILE))
    try:
        if path.stat().st_mode & 0o077:
            raise InputError(f"{path}: others may read this key; chmod 600 {path}")
        return path.read_text(encoding="ascii").strip() or None
    except FileNotFoundError as error:
        if named:
            raise InputError(f"{path}: there is no such key file; correct BSCD_KEY_FILE") from error
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can not be read ({error}); it holds what bscd keys add printed") from error
