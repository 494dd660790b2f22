"""An inflation on the twin, rendered once and kept in the machine's folder for temporary files."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

import numpy as np

from bscd.acquisition import RunFile
from bscd.acquisition.layout import RUN_FILE
from drivers.twin.options import TwinOptions
from tests.procedures.measuring.twin_runs import REST_KPA, TwinRuns, wide_calibration, write

REST_FRAMES, RAMP_FRAMES, TOP_KPA = 5, 55, 13.0

#: A rise, or a rise, a fall and a rise of the same images.
FRAMES = (60, 180)


def prepared() -> Path:
    """A folder with a new cal.h5 and a run of each of `FRAMES`; the runs are made the first time (ten seconds)."""
    made_from = f"{TwinOptions().model_dump_json()} {REST_FRAMES} {RAMP_FRAMES} {TOP_KPA} {RUN_FILE.version}"
    folder = Path(tempfile.gettempdir()) / f"bscd-bench-{hashlib.sha256(made_from.encode()).hexdigest()[:12]}"
    if not (folder / "ready").exists():
        folder.mkdir(exist_ok=True)
        for left_over in folder.iterdir():
            left_over.unlink()
        _make(folder)
        (folder / "ready").touch()
    (folder / "cal.h5").unlink(missing_ok=True)
    wide_calibration().save(folder / "cal.h5")
    return folder


def _make(folder: Path) -> None:
    pressures = [*[REST_KPA] * REST_FRAMES, *np.linspace(REST_KPA, TOP_KPA, RAMP_FRAMES + 1)[1:]]
    runs = TwinRuns()
    rise = runs.inflation(pressures)
    runs.world.close()
    write(folder / "60.h5", rise)
    images = [*rise, *rise[::-1], *rise]
    write(folder / "180.h5", [TwinRuns.frame(r.data, k, r.pressure_kpa) for k, r in enumerate(images)])
    for count in FRAMES:
        with RunFile(folder / f"{count}.h5") as run:
            assert len(run.table()) == count
