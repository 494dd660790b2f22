"""`bscd serve` as a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from bscd.api.server import Server, listening
from bscd.client import Client
from bscd.daemon.daemon import Daemon
from bscd.daemon.documents import JobDocument
from tests.daemon.small import WAIT_S, config_text, until

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class ServedProcess:
    """A daemon's process: where it answers, and what it logged."""

    process: subprocess.Popen[str]
    url: str = ""
    estop_url: str = ""
    log: list[str] = field(default_factory=list)

    def kill(self) -> None:
        """SIGKILL; returns when it is gone."""
        self.process.kill()
        self.process.wait(WAIT_S)


@contextmanager
def serving(config: Path, *options: str, env: dict[str, str] | None = None) -> Iterator[ServedProcess]:
    """Serve until the block ends; then it is asked to end, and must do so by itself."""
    process = subprocess.Popen(
        [Path(sys.executable).with_name("bscd"), "serve", "--config", config, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | (env or {}),
    )
    served = ServedProcess(process)
    reader = threading.Thread(target=lambda: served.log.extend(process.stderr or ()), daemon=True)
    reader.start()
    try:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(2)]
        assert all(lines), "".join(served.log)
        served.url, served.estop_url = (line.split(": ")[0] for line in lines)
        yield served
    finally:
        if process.poll() is None:
            process.terminate()
        try:
            process.wait(WAIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        finally:
            process.wait(WAIT_S)
            reader.join(WAIT_S)
            for pipe in (process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()


@contextmanager
def api_of(daemon: Daemon, port: int = 0) -> Iterator[httpx.Client]:
    """A daemon of this process behind its real server, and a plain client of it."""
    ready = threading.Event()
    with closing(listening("127.0.0.1", port)) as place:
        server = Server(daemon, ready.set)
        thread = threading.Thread(target=lambda: server.run(sockets=[place]), daemon=True)
        thread.start()
        assert ready.wait(WAIT_S)
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{place.getsockname()[1]}", timeout=WAIT_S) as client:
                yield client
        finally:
            server.should_exit = True
            thread.join(WAIT_S)


def configuration(folder: Path, sensor_px: int = 1280, changes: dict[str, str] | None = None, **daemon: object) -> Path:
    """A configuration file in ``folder``, its data beside it."""
    text = config_text(sensor_px, **({"requests_per_s": 10_000.0} | daemon))
    for old, new in (changes or {}).items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def idle(client: Client) -> None:
    """Wait until the rig is connected and does nothing."""
    until(lambda: client.status().state.value == "idle", "an idle rig")


def progressed(client: Client, job: JobDocument, done: int) -> JobDocument:
    """Wait until so much of a job is done."""
    until(lambda: (now := client.job(job.id)).status.ended or (now.progress and now.progress.done >= done), "progress")
    return client.job(job.id)
