"""A Dask scheduler and two workers on the loopback interface, each a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import ROOT

START_S = 60.0


@dataclass
class Cluster:
    address: str
    workers: list[subprocess.Popen[bytes]]


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """Ended with the block."""
    told = folder / "scheduler.json"
    processes: list[subprocess.Popen[bytes]] = []

    def start(name: str, program: str, *arguments: str) -> None:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "20s"}
        with (folder / f"{name}.log").open("wb") as log:
            processes.append(
                subprocess.Popen(
                    [sys.executable, "-m", f"distributed.cli.{program}", "--scheduler-file", str(told), *arguments],
                    cwd=folder,
                    env=environment,
                    stdout=log,
                    stderr=log,
                )
            )

    try:
        start("scheduler", "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        address = wait_for_address(told)
        for name in ("one", "two"):
            start(name, "dask_worker", "--name", name, "--nthreads", "1", "--no-nanny", "--no-dashboard")
        wait_for_workers(folder, ("one", "two"))
        yield Cluster(address, processes[1:])
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(10.0)


def wait_for_address(told: Path) -> str:
    ends = time.monotonic() + START_S
    while time.monotonic() < ends:
        try:
            return json.loads(told.read_text())["address"]
        except (FileNotFoundError, json.JSONDecodeError):
            time.sleep(0.05)
    raise TimeoutError((told.parent / "scheduler.log").read_text())


def wait_for_workers(folder: Path, names: tuple[str, ...]) -> None:
    ends = time.monotonic() + START_S
    logs = [folder / f"{name}.log" for name in names]
    while time.monotonic() < ends:
        if all("Starting established connection" in log.read_text() for log in logs):
            return
        time.sleep(0.05)
    raise TimeoutError("".join(log.read_text() for log in logs))
