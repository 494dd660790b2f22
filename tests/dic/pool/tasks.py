"""Work for pools, of a module that their workers can import."""

import os
import signal
import time
from pathlib import Path

import numpy as np


def total(image, factor):
    return float(np.sum(image.read(), dtype=np.float64)) * factor


def process_id():
    return os.getpid()


def priority():
    return os.nice(0)


def fail(text):
    raise ValueError(text)


class Local(Exception):
    def __init__(self, one, two):
        super().__init__(f"{one} {two}")


def fail_oddly():
    raise Local("an error", "that can not be unpickled")


def die_once(mark):
    """Kill the worker, but not the second time."""
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def wait_for(mark, started=None):
    """Until a file is there."""
    if started is not None:
        Path(started).touch()
    ends = time.monotonic() + 60.0
    while not Path(mark).exists() and time.monotonic() < ends:
        time.sleep(0.01)
    return str(mark)
