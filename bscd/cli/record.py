"""`bscd record`: an inflation on the configured rig, or on the twin in real time."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Literal

import typer

from bscd.acquisition import Compression
from bscd.calibration import Calibration
from bscd.cli.following import following
from bscd.cli.live import live_bytes, live_progress, told_live
from bscd.cli.terminal_operator import TerminalOperator
from bscd.composition import build_devices, build_world
from bscd.config import RigConfig, load_config
from bscd.errors import CheckFailedError, InputError
from bscd.procedures import Progress, ProgressCallback, Rig
from bscd.procedures.live import record_and_measure
from bscd.procedures.measuring import MeasureSettings
from bscd.procedures.recording import Ending, InflationRecipe, Recording, Storing, record_inflation
from bscd.procedures.recording.signals import ENDING_SIGNALS
from drivers.clock import Clock, HostClock
from drivers.operator import Operator

DEFAULT_CONFIG = Path(__file__).resolve().parents[2] / "config/twin.toml"
MANUAL_JACKS = "axis.manual"

LONGEST_S = 90_000.0
"""Longest ramp and longest hold of a recipe together."""

#: What the command line has for a recipe's fields.
_OPTIONS = {
    "rest_kpa": "--rest",
    "top_kpa": "--top",
    "rest_frames": "--rest-frames",
    "ramp_s": "--ramp (60 % of --duration where it is not given)",
    "hold_s": "the hold (--duration less --ramp)",
    "steps": "--steps",
    "frame_rate_hz": "--rate",
    "limit_kpa": "--limit",
    "exposure_s": "--exposure (or [scan] exposure_s)",
    "gain_db": "[scan] gain_db",
}


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def record(
        out: Annotated[Path, typer.Argument(help="The run file to make; it must not exist.")],
        config: Annotated[Path, typer.Option(help="The rig; the built-in twin without it.")] = DEFAULT_CONFIG,
        rate: Annotated[float, typer.Option(min=0.01, help="Frames a second.")] = 11.0,
        top: Annotated[float, typer.Option(help="Highest pressure, kPa.")] = 16.0,
        duration: Annotated[float, typer.Option(min=0.1, max=LONGEST_S, help="Ramp and hold together, s.")] = 6.5,
        ramp: Annotated[float | None, typer.Option(help="Ramp alone, s; default: 60 % of the duration.")] = None,
        steps: Annotated[int, typer.Option(min=0, help="Equal steps of the ramp; 0: a linear ramp.")] = 0,
        rest: Annotated[float, typer.Option(help="Pressure of the reference frames, kPa.")] = 0.05,
        rest_frames: Annotated[int, typer.Option(min=1, help="Reference frames.")] = 24,
        limit: Annotated[float | None, typer.Option(help="Pressure that ends it, kPa; default: a tenth more.")] = None,
        exposure: Annotated[float | None, typer.Option(help="Exposure, s; default: that of [scan].")] = None,
        pacing: Annotated[
            Literal["hardware", "software"], typer.Option(help="Whose clock asks for the frames.")
        ] = "hardware",
        compression: Annotated[Compression, typer.Option(help="Of the images in the file.")] = "none",
        sync: Annotated[bool, typer.Option(help="Wait for the disk every second, against power failures.")] = True,
        calibration: Annotated[
            Path | None, typer.Option(help="Measure the frames with this calibration as they arrive.")
        ] = None,
        results: Annotated[
            Path | None, typer.Option(help="Results file of that; default: beside the run, RUN-result.h5.")
        ] = None,
        step: Annotated[
            int | None, typer.Option(min=1, help="Distance between live points, px; default: [dic] step_px.")
        ] = None,
        workers: Annotated[int, typer.Option(min=1, help="Processes that correlate live.")] = 2,
    ) -> None:
        """Record an inflation: frames at rest, the ramp, the hold, the vent. Ctrl-C ends it early, vented.

        Lab jacks that are turned by hand ask for their height at the terminal.

        Example: bscd record inflation.h5 --config rig.toml --top 13 --duration 10 --calibration calibration.h5
        """
        if calibration is None and (results is not None or step is not None):
            raise typer.BadParameter("--results and --step need --calibration")
        chosen = load_config(config)
        text = config.read_text(encoding="utf-8")
        ramp_s = 0.6 * duration if ramp is None else ramp
        if not 0.0 < ramp_s <= duration:
            raise InputError(f"a ramp of {ramp_s:g} s does not fit a duration of {duration:g} s; change --ramp")
        try:
            recipe = InflationRecipe(
                rest_kpa=rest,
                top_kpa=top,
                rest_frames=rest_frames,
                ramp_s=ramp_s,
                hold_s=duration - ramp_s,
                steps=steps,
                frame_rate_hz=rate,
                limit_kpa=limit,
                pacing=pacing,
                exposure_s=chosen.scan.exposure_s if exposure is None else exposure,
                gain_db=chosen.scan.gain_db,
            )
        except ValueError as err:  # pydantic's tells a line for each
            raise InputError(_told(err)) from err
        storing = Storing(compression=compression, sync=sync)
        how: dict[str, Any] = {"config_text": text, "storing": storing}
        stop = threading.Event()
        connected = rig_of(chosen, rest_kpa=rest, operator=TerminalOperator(stop))
        if calibration is None:
            with connected as rig, stopping(stop), following("Inflation", "frames") as progress:
                done = record_inflation(rig, recipe, out, progress=unheard(progress), stop=stop, **how)
            typer.echo(_summary(done, recipe))
            return
        loaded = Calibration.load(calibration)
        settings = MeasureSettings(
            step_px=step or chosen.dic.step_px, subset_px=chosen.dic.subset_px, phase="inflation"
        )
        kept = results or out.with_name(f"{out.stem}-result.h5")
        with connected as rig, stopping(stop), live_progress() as (progress, on_event):
            how["storing"] = replace(storing, beside_bytes=live_bytes(rig, recipe, settings, out, kept))
            done, measured = record_and_measure(
                rig,
                recipe,
                out,
                loaded,
                kept,
                settings=settings,
                calibration_name=calibration.name,
                workers=workers,
                on_event=on_event,
                progress=unheard(progress),
                stop=stop,
                **how,
            )
        typer.echo(_summary(done, recipe))
        if measured.failure:
            raise CheckFailedError(measured.failure)
        typer.echo(f"{kept}: {told_live(measured)}")


@contextmanager
def rig_of(
    config: RigConfig, clock: Clock | None = None, *, rest_kpa: float = 0.0, operator: Operator | None = None
) -> Iterator[Rig]:
    """The configured rig, connected and vented; with a [twin] the twin, its axes homed and the membrane on its stage.

    ``operator`` is asked for the height of lab jacks that are turned by hand. The twin's image at ``rest_kpa`` is
    rendered at once: it takes longer than a frame may.
    """
    clock = clock or HostClock()
    with ExitStack() as ends:
        world: Any = None
        if config.twin is not None:
            config = _homed(config)
            world = build_world(config, clock)
            ends.callback(world.close)
            world.place("membrane")
        rig = Rig(
            **build_devices(config, clock, world, operator),
            clock=clock,
            origin_mm=config.scan.origin_mm,
            raised_mm=config.prism.raised_mm,
            lowered_mm=config.prism.lowered_mm,
        )
        ends.callback(rig.close)
        rig.connect()
        if rig.pressure is not None and rig.pressure.info().can_set:
            rig.pressure.vent()  # of what a program that crashed has left
        if config.devices.jacks.driver == MANUAL_JACKS:
            rig.jacks.home()  # nothing turns: the height is asked for, which nobody knows as yet
        if world is not None:
            world.irradiance("primary", world.state()._replace(pressure_kpa=rest_kpa))
        yield rig


def _homed(config: RigConfig) -> RigConfig:
    """The twin as its scans left it: homing in real time would take a minute and a half."""
    changes = {}
    for role in ("rotation", "translation", "jacks"):
        section = getattr(config.devices, role)
        if section.driver == "axis.simulated":
            given = section.options.model_dump() | {"homed_at_start": True}
            changes[role] = section.model_copy(update={"options": type(section.options).model_validate(given)})
    return config.model_copy(update={"devices": config.devices.model_copy(update=changes)})


@contextmanager
def stopping(stop: threading.Event) -> Iterator[None]:
    """Ctrl-C, SIGTERM and a terminal that is closed set the event; once more ends the program, when it is vented."""
    came: set[int] = set()

    def asked(number: int, frame: FrameType | None) -> None:
        if number in came:
            raise KeyboardInterrupt
        came.add(number)
        stop.set()

    # nohup has SIGHUP ignored
    heeded = [number for number in ENDING_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, asked) for number in heeded}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def unheard(progress: ProgressCallback) -> ProgressCallback:
    """The same, which goes on without a word when the terminal or whoever read it is gone."""

    def report(now: Progress) -> None:
        with suppress(OSError):
            progress(now)

    return report


def _told(err: ValueError) -> str:
    problems = getattr(err, "errors", None)
    if problems is None:
        return str(err)
    return "; ".join(
        f"{_named(one['loc'])} {one['msg'].removeprefix('Value error, ').replace('Input should', 'should')}".strip()
        for one in problems()
    )


def _named(place: tuple[int | str, ...]) -> str:
    return _OPTIONS.get(str(place[0]), str(place[0])) if place else ""


def _summary(done: Recording, recipe: InflationRecipe) -> str:
    lost = f"{done.lost_frames} lost" + (f", {done.incomplete_frames} incomplete" if done.incomplete_frames else "")
    waited = f"at most {done.peak_fill} waiting for the disk"
    why = done.ending.value if done.ending is Ending.COMPLETED else f"ended by {done.reason}"
    return f"{done.path}: {done.frames} frames at {recipe.frame_rate_hz:g} a second, {lost}, {waited}; {why}"
