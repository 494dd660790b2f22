"""The parent's side of a worker: one library, one number of threads, one process."""

from __future__ import annotations

import json
import os
import select
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

_WORKER = Path(__file__).with_name("worker.py")
_ANSWER_S = 900.0
_END_S = 10.0
_THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class WorkerError(Exception):
    """A library failed on a pair, or its process ended or did not answer in time."""


@dataclass(frozen=True)
class Matches:
    """What a library found at the points asked for, and what that took.

    ``displacement_px (N, 2)``, NaN where not ``valid (N,)``; ``sigma_px (N, 2)`` from libraries that give it.
    """

    displacement_px: NDArray[np.float64]
    valid: NDArray[np.bool_]
    sigma_px: NDArray[np.float64] | None
    seconds: float
    peak_mb: float


class Worker:
    """A library ready to correlate; use it as a context, so that its process ends."""

    def __init__(self, library: str, python: Path, threads: int) -> None:
        self.library, self.threads = library, threads
        self._folder = tempfile.TemporaryDirectory()
        limits = {name: str(threads) for name in _THREAD_LIMITS}
        self._process = subprocess.Popen(
            [str(python), str(_WORKER), library, str(threads)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | limits,
            text=True,
        )

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, kind: type[BaseException] | None, err: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def correlate(
        self,
        reference: NDArray[np.uint8],
        current: NDArray[np.uint8],
        points_px: NDArray[np.int64],
        *,
        subset_px: int = 21,
        step_px: int = 5,
        largest_px: float = 10.0,
        options: Mapping[str, Any] | None = None,
    ) -> Matches:
        """Match the whole-image grid ``points_px (N, 2)``, whole pixels ``step_px`` apart.

        ``largest_px`` tells peers that need it how far points may move; ``options`` go to the library, such as
        a "shape" other than "affine". Raises `WorkerError`.
        """
        folder = Path(self._folder.name)
        job: dict[str, Any] = {"subset_px": subset_px, "step_px": step_px, "largest_px": largest_px}
        job["options"] = dict(options or {})
        for name, array in (("reference", reference), ("current", current), ("points", points_px)):
            job[name] = str(folder / f"{name}.npy")
            np.save(job[name], array)
        job["answer"] = str(folder / "answer.npz")
        said = self._ask(job)
        if "error" in said:
            raise WorkerError(f"{self.library}: {said['error']}")
        with np.load(job["answer"]) as found:
            return Matches(
                found["displacement_px"], found["valid"], found.get("sigma_px"), said["seconds"], said["peak_mb"]
            )

    def close(self) -> None:
        """End the process and remove its files."""
        if self._process.stdin:
            self._process.stdin.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(_END_S)
        if self._process.stdout:
            self._process.stdout.close()
        self._folder.cleanup()

    def _ask(self, job: dict[str, Any]) -> dict[str, Any]:
        asked, answers = self._process.stdin, self._process.stdout
        if asked is None or answers is None:
            raise WorkerError(f"{self.library}: its process has no pipes")
        try:
            print(json.dumps(job), file=asked, flush=True)
        except BrokenPipeError as err:
            raise WorkerError(f"{self.library}: its process has ended; it can not be imported here") from err
        if not select.select([answers], [], [], _ANSWER_S)[0]:
            self._process.kill()
            raise WorkerError(f"{self.library}: no answer within {_ANSWER_S:.0f} s")
        line = answers.readline()
        if not line:
            raise WorkerError(f"{self.library}: its process ended without an answer")
        return json.loads(line)
