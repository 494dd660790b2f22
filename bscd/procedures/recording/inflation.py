"""Record an inflation through the biprism (paper, section 2.3): rest, ramp, hold, vent."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from pathlib import Path

from bscd.acquisition import CameraMeta, FrameRecord, PressureMeta, RunWriter
from bscd.errors import CheckFailedError, InputError
from bscd.procedures.progress import Progress, ProgressCallback, require_going
from bscd.procedures.recording.ending import safe_ending
from bscd.procedures.recording.recipes import InflationRecipe
from bscd.procedures.recording.requirements import require_inflation
from bscd.procedures.recording.result import Recording
from bscd.procedures.rig import Rig
from bscd.procedures.taking import TIMEOUT_MARGIN_S, axes_of, send
from drivers.interfaces import Frame, FrameStatus, PressureReading, PressureSource

#: Readings in a row that must be at rest, and the time between them.
_AT_REST_READINGS = 5
_BETWEEN_READINGS_S = 0.1


def record_inflation(
    rig: Rig,
    recipe: InflationRecipe,
    path: str | Path,
    *,
    title: str = "inflation",
    config_text: str = "",
    progress: ProgressCallback | None = None,
    stop: threading.Event | None = None,
) -> Recording:
    """Record an inflation into a new run file: each frame with the pressure in the middle of its exposure.

    Frames are streamed at the recipe's rate. A frame that is lost on the way leaves its number out, and an event in
    the file says so. However it ends the membrane is vented, the axes are at rest and the file is readable.

    Raises
    ------
    InputError
        The rig can not do it, or the file exists; nothing moved, no pressure was set.
    CheckFailedError
        The pressure did not come to rest.
    ProcedureStoppedError
        ``stop`` was set; checked between frames.
    NotVentedError
        The vent failed; the message says what ended the recording before.
    drivers.errors.DeviceError
        A device failed.
    """
    path = Path(path)
    require_inflation(rig, recipe, path)
    source = rig.pressure
    if source is None:
        raise InputError("inflation: the rig has no pressure source; configure [devices.pressure]")
    info = source.info()
    writer = RunWriter(
        path,
        title=title,
        cameras={"primary": CameraMeta.from_info(rig.primary.info())},
        config_text=config_text,
        recipe_text=recipe.model_dump_json(),
        axes=axes_of(rig),
        pressure=PressureMeta(info.limits_kpa, info.noise_kpa, info.vendor, info.model, info.serial),
    )
    begun_s = rig.clock.now_s()
    report = progress or (lambda _: None)
    with writer, safe_ending(rig):
        require_going(stop, "inflation: before it began")
        send(rig.jacks, rig.raised_mm, writer, "jack")
        rig.primary.configure(exposure_s=recipe.exposure_s, gain_db=recipe.gain_db, frame_rate_hz=recipe.frame_rate_hz)
        source.set_pressure(recipe.rest_kpa)
        _come_to_rest(rig, source, recipe)
        before = source.read()
        expected = lost = incomplete = 0
        first_ns = ramp_begun_s = None
        for number, frame in _streamed(rig, recipe):
            require_going(stop, f"inflation: after frame {number}")
            reading = source.read()
            first_ns = frame.camera_time_ns if first_ns is None else first_ns
            _write(rig, writer, frame, (frame.camera_time_ns - first_ns) * 1e-9, before, reading)
            lost += _told(writer, number - expected, f"before frame id {frame.frame_id}")
            incomplete += frame.status is not FrameStatus.OK
            before, expected = reading, number + 1
            if expected >= recipe.rest_frames:
                ramp_begun_s = rig.clock.now_s() if ramp_begun_s is None else ramp_begun_s
                source.set_pressure(recipe.set_point_kpa(rig.clock.now_s() - ramp_begun_s))
            report(Progress(expected, recipe.frame_count, f"{reading.pressure_kpa:.2f} kPa"))
        lost += _told(writer, recipe.frame_count - expected, "at the end")
        frames = writer.frames_written
    return Recording(path, frames, lost, incomplete, rig.clock.now_s() - begun_s)


def _told(writer: RunWriter, lost: int, where: str) -> int:
    """How many frames were lost, with an event in the file that says so."""
    if lost:
        writer.event(f"{lost} frame{'s' * (lost > 1)} lost {where}")
    return lost


def _come_to_rest(rig: Rig, source: PressureSource, recipe: InflationRecipe) -> None:
    """Let the pressure settle, then wait until it has been at rest for a few readings."""
    rig.clock.sleep(recipe.rest_settle_s)
    allowed_kpa = recipe.rest_tolerance_kpa + 3.0 * _known(source.info().noise_kpa)
    end_s = rig.clock.now_s() + recipe.rest_timeout_s
    at_rest = 0
    while at_rest < _AT_REST_READINGS:
        reading = source.read()
        at_rest = at_rest + 1 if abs(reading.pressure_kpa - recipe.rest_kpa) <= allowed_kpa else 0
        if not at_rest and rig.clock.now_s() >= end_s:
            raise CheckFailedError(
                f"inflation: the pressure is {reading.pressure_kpa:.3f} kPa after {recipe.rest_timeout_s:g} s, not "
                f"{recipe.rest_kpa:g}; look for a leak, or allow more with rest_tolerance_kpa"
            )
        rig.clock.sleep(_BETWEEN_READINGS_S)


def _streamed(rig: Rig, recipe: InflationRecipe) -> Iterator[tuple[int, Frame]]:
    """The exposure's number from 0 and its frame, up to the recipe's last exposure."""
    timeout_s = rig.primary.status().exposure_s + 1.0 / recipe.frame_rate_hz + TIMEOUT_MARGIN_S
    rig.primary.start()
    frame = rig.primary.read(timeout_s)
    first = frame.frame_id - rig.primary.status().lost_frames
    while (number := frame.frame_id - first) < recipe.frame_count:
        yield number, frame
        if number + 1 == recipe.frame_count:
            return
        frame = rig.primary.read(timeout_s)


def _write(
    rig: Rig, writer: RunWriter, frame: Frame, time_s: float, before: PressureReading, after: PressureReading
) -> None:
    status = rig.primary.status()
    writer.log_pressure(after)
    writer.append(
        FrameRecord(
            camera="primary",
            phase="inflation",
            data=frame.data,
            frame_id=frame.frame_id,
            camera_time_ns=frame.camera_time_ns,
            host_time_ns=frame.host_time_ns,
            status=frame.status,
            jack_mm=rig.jacks.status().position,
            pressure_kpa=_between_kpa(frame.host_time_ns - round(status.exposure_s / 2.0 * 1e9), before, after),
            exposure_s=status.exposure_s,
            gain_db=status.gain_db,
            time_s=time_s,
        )
    )


def _between_kpa(time_ns: int, before: PressureReading, after: PressureReading) -> float:
    """The pressure at a time of the host's clock, linear between the readings around it."""
    span_ns = after.host_time_ns - before.host_time_ns
    share = min(max((time_ns - before.host_time_ns) / span_ns, 0.0), 1.0) if span_ns > 0 else 1.0
    return before.pressure_kpa + share * (after.pressure_kpa - before.pressure_kpa)


def _known(value: float) -> float:
    return value if math.isfinite(value) else 0.0
