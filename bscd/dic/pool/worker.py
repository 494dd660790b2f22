"""What a worker process does: one task after the other, until its pipe ends."""

from __future__ import annotations

import os
import pickle
import signal
import sys
from multiprocessing.connection import Connection
from typing import Any

import cv2


def serve(tasks: Connection, threads: int, nice: int) -> None:
    """Do the tasks that come: (work, arguments) pickled, answered by (True, result) or (False, what was raised)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started the pool is interrupted, and closes it
    if nice:
        os.nice(nice)
    cv2.setNumThreads(threads)
    while True:
        try:
            tasks.send_bytes(_answer(tasks.recv_bytes()))
        except (EOFError, OSError):  # the pool was closed, or whoever had it is gone
            return


def _answer(given: bytes) -> bytes:
    try:
        work, arguments = pickle.loads(given)  # noqa: S301 - from the process that started this one
        return pickle.dumps((True, work(*arguments)), pickle.HIGHEST_PROTOCOL)
    except Exception as error:  # handed to whoever asked, who judges it
        return _failure(error)


def _failure(error: Exception) -> bytes:
    error.__cause__ = error.__context__ = None  # may hold what can not be pickled
    try:
        told = pickle.dumps((False, error), pickle.HIGHEST_PROTOCOL)
        pickle.loads(told)  # noqa: S301 - just written
    except Exception:  # an error that can not travel is told in words
        words: Any = RuntimeError(f"{type(error).__name__}: {error}")
        return pickle.dumps((False, words), pickle.HIGHEST_PROTOCOL)
    return told


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])), threads=int(sys.argv[2]), nice=int(sys.argv[3]))
