"""Ours and the peers, each ready to be started."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from tests.benchmarks.peers.environment import PeersMissingError, peers_python
from tests.benchmarks.peers.process import Worker

OURS = "bscd"


@dataclass(frozen=True)
class Library:
    """A correlator by the name of its adapter, and the Python that has it."""

    name: str
    title: str
    python: Path

    def start(self, threads: int) -> Worker:
        return Worker(self.name, self.python, threads)


def libraries(peers: bool, ours: bool = True) -> tuple[list[Library], list[str]]:
    """What can be measured here, ours first, and a remark for what can not."""
    found, remarks = [], []
    if ours:
        found.append(Library(OURS, OURS, Path(sys.executable)))
    if peers:
        try:
            python = peers_python()
            found += [Library("pyvale", "pyvale", python), Library("aldic", "pyALDIC", python)]
        except PeersMissingError as err:
            remarks.append(f"the peers could not be installed: {err}")
    return found, remarks
