"""`bscd demo`: the whole calibration on the built-in digital twin, in virtual time, held against its truth."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer

from bscd.acquisition import PhaseName, RunFile
from bscd.analysis.report import ReportData, RunOrigin, write_report
from bscd.analysis.validation import ErrorFigure, Validation, compare_variants, validate
from bscd.calibration import Calibration, View
from bscd.cli.composition import build_devices, build_world
from bscd.cli.following import following
from bscd.cli.twin_truth import WitnessedCamera, with_truth
from bscd.config import RigConfig, parse_config
from bscd.errors import InputError
from bscd.procedures import (
    Rig,
    ScanRecipe,
    calibrate_observations,
    home,
    observe,
    record_scan,
    record_validation,
)
from bscd.procedures.calibrate import origins_of, stage_repeatability
from drivers.clock import VirtualClock
from drivers.interfaces import Camera

DEFAULT_CONFIG = Path(__file__).resolve().parents[2] / "config/twin.toml"
_MARKER = ".bscd-demo"
_FILES = ("reference.h5", "bsc.h5", "pos0.h5", "between.h5", "calibration.h5", "report.html", "summary.json")


@dataclass(frozen=True)
class DemoResult:
    """What the demo made: its folder, the calibration, both validations, and the figures of summary.json (mm)."""

    folder: Path
    calibration: Calibration
    pos0: Validation
    volume: Validation
    summary: dict[str, Any]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def demo(
        out: Annotated[Path, typer.Option(help="Folder for the report, the figures and the run files.")] = Path(
            "demo-out"
        ),
        config: Annotated[Path, typer.Option(help="Another twin than the built-in one.")] = DEFAULT_CONFIG,
    ) -> None:
        """Scan, calibrate and validate the digital twin; write report.html and summary.json.

        Example: bscd demo --out demo-out
        """
        begun = time.monotonic()
        result = run_demo(out, config.read_text(encoding="utf-8"), str(config))
        for line in _told(result.summary):
            typer.echo(line)
        typer.echo(f"{result.folder / 'report.html'} ({time.monotonic() - begun:.0f} s)")


def run_demo(out: Path, config_text: str, config_name: str = "configuration") -> DemoResult:
    """Run the demo into ``out``: a new folder, or one that an earlier demo made."""
    config = parse_config(config_text, config_name)
    if config.twin is None:
        raise InputError(f"{config_name}: the demo needs a [twin] section; take config/twin.toml")
    _prepare(out)
    started, begun = datetime.now(UTC), time.monotonic()
    clock = VirtualClock()
    world = build_world(config, clock)
    try:
        rig, witness = _rig(config, clock, world)
        rig.connect()
        try:
            home(rig)
            calibration, runs, reference_views = _calibrate(rig, config, config_text, out)
            views = _second_acquisition(rig, config, config_text, out)
        finally:
            rig.close()
        target = config.target.grid()
        with RunFile(out / "pos0.h5") as pos0_run, RunFile(out / "between.h5") as volume_run:
            pos0 = with_truth(validate(calibration, views["pos0"], target), pos0_run, witness, world)
            volume = with_truth(validate(calibration, views["between"], target), volume_run, witness, world)
            variants = compare_variants(calibration, views["between"], target)
            runs += [_origin(pos0_run), _origin(volume_run)]
        summary = _summary(calibration, pos0, volume)
    finally:
        world.close()
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    write_report(
        ReportData(
            title=f"Calibration of {config.rig.name}",
            started=started,
            duration_s=time.monotonic() - begun,
            calibration=calibration,
            target=target,
            image_size_px=_image_size(out / "bsc.h5"),
            pos0=pos0,
            volume=volume,
            variants=variants,
            standard_stereo=_standard(calibration),
            summary=summary,
            config_text=config_text,
            runs=runs,
            examples=_examples(out),
            reference_views=reference_views,
        ),
        out,
    )
    return DemoResult(out, calibration, pos0, volume, summary)


def _prepare(out: Path) -> None:
    if out.exists() and any(out.iterdir()) and not (out / _MARKER).exists():
        raise InputError(f"{out}: holds files that no demo made; name a new folder with --out")
    out.mkdir(parents=True, exist_ok=True)
    (out / _MARKER).touch()
    for name in _FILES:
        (out / name).unlink(missing_ok=True)


def _rig(config: RigConfig, clock: VirtualClock, world: Any) -> tuple[Rig, WitnessedCamera]:
    devices = build_devices(config, clock, world)
    witness = WitnessedCamera(devices.pop("primary"), world)
    rig = Rig(
        primary=cast(Camera, witness),
        **devices,
        clock=clock,
        origin_mm=config.scan.origin_mm,
        raised_mm=config.prism.raised_mm,
        lowered_mm=config.prism.lowered_mm,
    )
    return rig, witness


def _recipe(config: RigConfig, **changes: Any) -> ScanRecipe:
    scan = config.scan
    common: dict[str, Any] = {
        "positions": scan.positions,
        "step_mm": scan.step_mm,
        "frames_per_position": scan.frames_per_position,
        "poses": scan.poses,
        "corner_rotation_deg": scan.corner_rotation_deg,
        "face_rotation_deg": scan.face_rotation_deg,
        "settle_s": scan.settle_s,
        "exposure_s": scan.exposure_s,
        "gain_db": scan.gain_db,
    }
    return ScanRecipe(**{**common, **changes})


def _calibrate(
    rig: Rig, config: RigConfig, text: str, out: Path
) -> tuple[Calibration, list[RunOrigin], Sequence[View]]:
    target = config.target.grid()
    for kind, title in (("reference", "Reference scan"), ("bsc", "Biprism scan")):
        with following(title) as progress:
            record_scan(
                rig, _recipe(config, kind=kind), target, out / f"{kind}.h5", config_text=text, progress=progress
            )
    with RunFile(out / "reference.h5") as reference, RunFile(out / "bsc.h5") as bsc:
        with following("Dots", "images") as progress:
            seen = observe(reference, target, "reference", progress=progress)
            seen_bsc = observe(bsc, target, "bsc", progress=progress)
        calibration = calibrate_observations(
            seen,
            seen_bsc,
            target,
            config.calibration.choices(),
            origins=origins_of(reference, bsc, datetime.now(UTC)),
            repeatability=stage_repeatability(bsc),
        )
        origins = [_origin(reference), _origin(bsc)]
    calibration.save(out / "calibration.h5")
    return calibration, origins, seen.views


def _second_acquisition(rig: Rig, config: RigConfig, text: str, out: Path) -> dict[str, Sequence[View]]:
    """The face at POS.0 once more, and between the positions, turned by a few degrees; the dots of both."""
    target = config.target.grid()
    recipe = _recipe(config, kind="bsc", poses=("face",))
    with following("Validation scan") as progress:
        again = recipe.model_copy(update={"y_offsets_mm": (0.0,)})
        record_scan(rig, again, target, out / "pos0.h5", title="face at POS.0 once more", config_text=text)
        record_validation(rig, recipe, target, out / "between.h5", config_text=text, progress=progress)
    views = {}
    with following("Validation", "images") as progress:
        for name in ("pos0", "between"):
            with RunFile(out / f"{name}.h5") as run:
                views[name] = observe(run, target, "bsc", phases=["bsc-face"], progress=progress).views
    return views


def _origin(run: RunFile) -> RunOrigin:
    return RunOrigin(run.path.name, run.uuid, run.checksum)


def _standard(calibration: Calibration) -> ErrorFigure:
    figures = calibration.figures
    return ErrorFigure(
        figures["standard_stereo_error_mean_mm"],
        figures["standard_stereo_error_std_mm"],
        int(figures["standard_stereo_points"]),
    )


def _summary(calibration: Calibration, pos0: Validation, volume: Validation) -> dict[str, Any]:
    """The figures as DESIGN section 5 has them."""
    return {
        "reference": _standard(calibration).summary(),
        "bsc_pos0": {which: pos0.figure(which).summary() for which in ("uncorrected", "corrected")},
        "volume": {
            "uncorrected": volume.figure("uncorrected").summary(),
            "corrected": volume.figure("corrected").summary(),
            "truth_corrected": volume.figure("corrected", "truth").summary(),
            "truth_floor": volume.figure("floor", "truth").summary(),
        },
    }


def _told(summary: dict[str, Any]) -> list[str]:
    def line(name: str, figure: dict[str, float], paper: str = "") -> str:
        return f"{name:<34}{figure['mean']:8.4f} +- {figure['std']:.4f} mm{paper}"

    pos0, volume = summary["bsc_pos0"], summary["volume"]
    return [
        line("standard stereo", summary["reference"], "   (paper 0.021 +- 0.032)"),
        line("biprism at POS.0, uncorrected", pos0["uncorrected"], "   (paper 0.17 +- 0.10)"),
        line("biprism at POS.0, corrected", pos0["corrected"], "   (paper 0.09 +- 0.05)"),
        line("volume, uncorrected", volume["uncorrected"]),
        line("volume, corrected", volume["corrected"]),
        line("volume, corrected, against truth", volume["truth_corrected"]),
        line("floor (exact rays, same pixels)", volume["truth_floor"]),
    ]


def _image_size(path: Path) -> tuple[int, int]:
    with RunFile(path) as run:
        camera = run.cameras["primary"]
        return camera.width_px, camera.height_px


def _examples(out: Path) -> dict[str, Any]:
    """One image of each kind, 8-bit."""
    wanted: dict[str, tuple[str, PhaseName]] = {
        "corner at POS.0 through the biprism": ("bsc.h5", "bsc-corner"),
        "face through the biprism": ("bsc.h5", "bsc-face"),
        "corner at POS.0 without it": ("reference.h5", "reference-corner"),
    }
    shown = {}
    for caption, (name, phase) in wanted.items():
        with RunFile(out / name) as run:
            record = next(iter(run.frames(camera="primary", phase=phase)))
            shown[caption] = np.asarray(record.data, np.uint8)
    return shown
