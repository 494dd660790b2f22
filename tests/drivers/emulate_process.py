"""The real `bscd emulate`, from "serving" to SIGTERM."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from drivers.emulators.rig import PORTS

BSCD = Path(sys.executable).with_name("bscd")


def free_ports() -> int:
    """The first of as many TCP ports in a row as it takes that nobody has."""
    for first in range(21_000, 60_000, 10):
        try:
            for port in range(first, first + len(PORTS)):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port))
        except OSError:
            continue
        return first
    raise OSError("no free ports")


@dataclass
class Emulation:
    """A running command: what it has said until it served, and its process."""

    lines: list[str]
    process: subprocess.Popen[str]

    def address(self, *, of: str, serial: bool = False) -> str:
        """Where it serves something."""
        (found,) = (line.split()[0] for line in self.lines if of in line and line.startswith("/" if serial else "tcp:"))
        return found

    def type(self, line: str) -> str:
        """Its answer, of one line."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().rstrip()


@contextmanager
def emulating(
    config: Path,
    *arguments: str,
    stdin: int = subprocess.DEVNULL,
    before: Sequence[str] = (),
    errors: Sequence[str] = (),
) -> Iterator[Emulation]:
    """The command, which writes ``config``; behind another one if need be, and with no other ``errors`` than these."""
    command = [str(BSCD), "emulate", "--write-config", str(config), "--first-port", str(free_ports()), *arguments]
    with subprocess.Popen(
        [*before, *command], stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        try:
            lines = []
            assert child.stdout is not None
            for line in child.stdout:
                lines.append(line.rstrip())
                if line.startswith("serving"):
                    break
            yield Emulation(lines, child)
        finally:
            child.send_signal(signal.SIGTERM)
            _, said = child.communicate(timeout=20)
        assert child.returncode == 0, said
        assert said.splitlines() == list(errors)
