"""Start a module of ours as a program, with a pipe to talk through."""

from __future__ import annotations

import os
import subprocess
import sys
from multiprocessing import Pipe
from multiprocessing.connection import Connection

#: A program that does not end by itself when its pipe is closed is killed.
_END_S = 5.0


def start_program(module: str, *arguments: object) -> tuple[subprocess.Popen[bytes], Connection]:
    """The process, and our end of its pipe; ``arguments`` follow the number of its own end.

    It knows nothing of this one's main module, and the terminal's Ctrl-C does not reach it.
    """
    ours, theirs = Pipe()
    given = [str(each) for each in (theirs.fileno(), *arguments)]
    process = subprocess.Popen(  # noqa: S603 - ourselves
        [sys.executable, "-P", "-m", module, *given],
        stdin=subprocess.DEVNULL,
        pass_fds=[theirs.fileno()],
        process_group=0,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
    )
    theirs.close()
    return process, ours


def end_program(process: subprocess.Popen[bytes], pipe: Connection, grace_s: float) -> None:
    """Close its pipe; kill it when it has not ended after ``grace_s``."""
    pipe.close()
    try:
        process.wait(grace_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(_END_S)
