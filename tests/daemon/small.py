"""A daemon on the twin, in virtual or real time, with axes that waste none."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from bscd.config import parse_config
from bscd.daemon.daemon import Daemon
from bscd.daemon.documents import JobDocument, JobStatus
from bscd.daemon.recipes import AnyRecipe
from drivers.clock import HostClock, VirtualClock
from tests.drivers.fast_twin import fast_twin

#: Generous: computers of two busy cores.
WAIT_S = float(os.environ.get("BSCD_TEST_WAIT_S", "120"))

RECIPE: TypeAdapter[Any] = TypeAdapter(AnyRecipe)


def config_text(sensor_px: int = 1280, **daemon: object) -> str:
    """The twin with fast axes, and a [daemon] that takes free ports and all of the disk."""
    text = fast_twin()
    if sensor_px != 1280:
        share = 1280 // sensor_px
        text = text.replace("width_px = 1280", f"width_px = {sensor_px}")
        text = text.replace("height_px = 1024", f"height_px = {1024 // share}")
        text = text.replace("pixel_size_mm = 0.0067", f"pixel_size_mm = {0.0067 * share:g}")
    given = {"port": 0, "estop_port": 0, "reserve_mb": 1.0, "poll_s": 0.1, "data_folder": "data"} | daemon
    lines = [f'{name} = "{value}"' if isinstance(value, str) else f"{name} = {value}" for name, value in given.items()]
    return text + "\n[daemon]\n" + "\n".join(lines) + "\n"


@contextmanager
def small_daemon(
    folder: Path,
    *,
    virtual: bool = True,
    connected: bool = True,
    attended: bool | None = None,
    sensor_px: int = 1280,
    changes: Mapping[str, str] | None = None,
    **daemon: object,
) -> Iterator[Daemon]:
    """A daemon whose data folder is ``folder``/data; in virtual time a scan takes as long as its pictures."""
    text = config_text(sensor_px, **daemon)
    for old, new in (changes or {}).items():
        assert old in text
        text = text.replace(old, new)
    clock = VirtualClock() if virtual else HostClock()
    with Daemon(parse_config(text), text, folder, clock=clock, attended=attended) as opened:
        if connected:
            opened.connect("test")
        yield opened


def recipe(kind: str, **values: Any) -> Any:
    """A recipe by its name."""
    return RECIPE.validate_python({"recipe": kind, **values})


@contextmanager
def homed_daemon(folder: Path) -> Iterator[Daemon]:
    """A small one that is homed, and asked as often as tests like."""
    with small_daemon(folder, sensor_px=320, requests_per_s=10_000.0) as opened:
        done(opened, "home")
        yield opened


def until(condition: Callable[[], Any], what: str) -> Any:
    """Wait for it."""
    ends = time.monotonic() + WAIT_S
    while not (found := condition()):
        assert time.monotonic() < ends, f"waited {WAIT_S:g} s for {what}"
        time.sleep(0.01)
    return found


def ended(daemon: Daemon, job: JobDocument) -> JobDocument:
    """The job at its end."""
    until(lambda: daemon.job(job.id).status.ended, f"the end of {job.recipe.recipe}")
    return daemon.job(job.id)


def done(daemon: Daemon, kind: str, **values: Any) -> JobDocument:
    """Have a recipe done; its end must be a good one."""
    job = ended(daemon, daemon.submit(recipe(kind, **values), "test"))
    assert job.status is JobStatus.DONE, job.reason
    return job
