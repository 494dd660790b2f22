"""The demo: everything in its order, then summary.json and the report."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from bscd.acquisition import PhaseName, RunFile
from bscd.analysis.report import ReportData, write_report
from bscd.analysis.report.measurement import MeasurementData
from bscd.analysis.validation import Validation, compare_variants, validate
from bscd.calibration import Calibration
from bscd.cli.demo import calibrating, measuring
from bscd.cli.demo.summary import summarise
from bscd.cli.progress import progress
from bscd.cli.twin_truth import WitnessedWorld, with_truth
from bscd.composition import build_devices, build_world
from bscd.config import RigConfig, parse_config
from bscd.errors import InputError
from bscd.offline.setup_facts import setup_facts
from bscd.procedures import Rig, home
from bscd.procedures.reporting import Source, gather_measurement
from bscd.results import ResultsFile
from drivers.clock import VirtualClock

_MARKER = ".bscd-demo"
_FILES = (
    *(f"{name}.h5" for name in ("reference", "bsc", "pos0", "between", "calibration")),
    *(measuring.SPHERE, measuring.SPHERE_RESULT, measuring.SPHERE_STANDARD),
    *(measuring.INFLATION, measuring.INFLATION_RESULT),
    *("report.html", "summary.json"),
)


@dataclass(frozen=True)
class DemoResult:
    """What the demo made: its folder, the calibration, both validations, and the figures of summary.json (mm)."""

    folder: Path
    calibration: Calibration
    pos0: Validation
    volume: Validation
    summary: dict[str, Any]


def run_demo(out: Path, config_text: str, config_name: str = "configuration") -> DemoResult:
    """Run the demo into ``out``: a new folder, or one that an earlier demo made."""
    config = parse_config(config_text, config_name)
    for section, there in (("[twin]", config.twin), ("[devices.pressure]", config.devices.pressure)):
        if there is None:
            raise InputError(f"{config_name}: the demo needs a {section} section; take config/twin.toml")
    _prepare(out)
    started, begun = datetime.now(UTC), time.monotonic()
    clock = VirtualClock()
    world = WitnessedWorld(build_world(config, clock), clock)
    try:
        rig = _rig(config, clock, world)
        rig.connect()
        try:
            home(rig)
            calibrated = calibrating.calibrate(rig, config, config_text, out)
            views = calibrating.second_acquisition(rig, config, config_text, out)
            recording = measuring.record(rig, world, config, config_text, out)
        finally:
            rig.close()
        target, calibration = config.target.grid(), calibrated.calibration
        with RunFile(out / "pos0.h5") as pos0_run, RunFile(out / "between.h5") as volume_run:
            pos0 = with_truth(validate(calibration, views["pos0"], target), pos0_run, world)
            volume = with_truth(validate(calibration, views["between"], target), volume_run, world)
            variants = compare_variants(calibration, views["between"], target)
        inflated = measuring.measure(calibration, recording, world, config, out)
    finally:
        world.close()
    with progress("Report", 2, "parts") as step:
        measured = _measured(calibration, config, config_text, inflated, out)
        summary = summarise(
            calibration, pos0, volume, measured, measuring.summary(inflated, out), inflated.sphere_centre_mm
        )
        (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
        step(1, "figures")
        data = ReportData(
            title=f"Calibration and measurement with {config.rig.name}",
            started=started,
            duration_s=time.monotonic() - begun,
            calibration=calibration,
            target=target,
            image_size_px=_image_size(out / "bsc.h5"),
            pos0=pos0,
            volume=volume,
            variants=variants,
            standard_stereo=calibrating.standard_stereo(calibration),
            summary=summary,
            config_text=config_text,
            runs=[*calibrated.runs, *_origins(out)],
            examples=_examples(out),
            reference_views=calibrated.reference_views,
            measurement=measured,
        )
        write_report(data, out)
        step(1, "done")
    return DemoResult(out, calibration, pos0, volume, summary)


def _measured(
    calibration: Calibration, config: RigConfig, text: str, inflated: measuring.Inflated, out: Path
) -> MeasurementData:
    """What the report tells of sphere and inflation."""
    with (
        ResultsFile(out / measuring.SPHERE_RESULT) as sphere,
        ResultsFile(out / measuring.SPHERE_STANDARD) as standard,
        ResultsFile(out / measuring.INFLATION_RESULT) as inflation,
        RunFile(out / measuring.SPHERE) as sphere_run,
        RunFile(out / measuring.INFLATION) as inflation_run,
    ):
        pairs = ((sphere, sphere_run), (standard, sphere_run), (inflation, inflation_run))
        return gather_measurement(
            [Source(results, run, calibration) for results, run in pairs],
            sphere_radius_mm=config.sphere.radius_mm,
            facts=setup_facts(text),
            truth_w_rms_mm=inflated.missed.uvw_rms_mm[:, 2],
        )


def _prepare(out: Path) -> None:
    if out.exists() and any(out.iterdir()) and not (out / _MARKER).exists():
        raise InputError(f"{out}: holds files that no demo made; name a new folder with --out")
    out.mkdir(parents=True, exist_ok=True)
    (out / _MARKER).touch()
    for name in _FILES:
        (out / name).unlink(missing_ok=True)


def _rig(config: RigConfig, clock: VirtualClock, world: WitnessedWorld) -> Rig:
    return Rig(
        **build_devices(config, clock, world),
        clock=clock,
        origin_mm=config.scan.origin_mm,
        raised_mm=config.prism.raised_mm,
        lowered_mm=config.prism.lowered_mm,
    )


def _origins(out: Path) -> list[Any]:
    origins = []
    for name in ("pos0.h5", "between.h5", measuring.SPHERE, measuring.INFLATION):
        with RunFile(out / name) as run:
            origins.append(calibrating.origin(run))
    return origins


def _image_size(path: Path) -> tuple[int, int]:
    with RunFile(path) as run:
        camera = run.cameras["primary"]
        return camera.width_px, camera.height_px


def _examples(out: Path) -> dict[str, Any]:
    """One image of each kind, 8-bit; the last where there are several."""
    wanted: dict[str, tuple[str, PhaseName, int]] = {
        "corner at POS.0 through the biprism": ("bsc.h5", "bsc-corner", 0),
        "face through the biprism": ("bsc.h5", "bsc-face", 0),
        "corner at POS.0 without it": ("reference.h5", "reference-corner", 0),
        "sphere through the biprism": (measuring.SPHERE, "sphere", 0),
        "membrane at rest": (measuring.INFLATION, "inflation", 0),
        "membrane at the highest pressure": (measuring.INFLATION, "inflation", -1),
    }
    shown = {}
    for caption, (name, phase, place) in wanted.items():
        with RunFile(out / name) as run:
            shown[caption] = np.asarray(list(run.frames("primary", phase))[place].data, np.uint8)
    return shown
