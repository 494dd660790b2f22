"""The virtual environment of the peers, apart from ours because their dependencies must not touch it."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
FOLDER = ROOT / ".venv-peers"
LISTS = [Path(__file__).with_name(name) for name in ("requirements.txt", "peers.txt")]

_INSTALL_S = 1800


class PeersMissingError(Exception):
    """The peers could not be installed; the benchmark goes on without them and says so."""


def peers_python() -> Path:
    """The peers' Python, after installing them (about a minute, 1 GB) where that is not done already.

    Raises `PeersMissingError` with pip's reason when they can not be installed.
    """
    python, done = FOLDER / "bin" / "python", FOLDER / ".installed"
    wanted = hashlib.sha256(b"".join(path.read_bytes() for path in LISTS)).hexdigest()
    if done.is_file() and done.read_text() == wanted:
        return python
    print(f"bench: installing the peers into {FOLDER.name}", file=sys.stderr, flush=True)
    _run([sys.executable, "-m", "venv", "--clear", str(FOLDER)])
    (FOLDER / ".gitignore").write_text("*\n")
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    _run([*pip, "-r", str(LISTS[0])])
    _run([*pip, "--no-deps", "-r", str(LISTS[1])])
    done.write_text(wanted)
    return python


def _run(command: list[str]) -> None:
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=_INSTALL_S)
    except subprocess.TimeoutExpired as err:
        raise PeersMissingError(f"installing took more than {_INSTALL_S} s") from err
    if ended.returncode:
        raise PeersMissingError((ended.stderr or ended.stdout).strip().splitlines()[-1])
