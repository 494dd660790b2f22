"""Record an inflation through the biprism (paper, section 2.3): rest, ramp, hold, vent."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from bscd.acquisition import CameraMeta, FrameRecord, PressureMeta, RunWriter
from bscd.acquisition.stream import Follower, StreamSession
from bscd.errors import InputError
from bscd.procedures.progress import Progress, ProgressCallback, require_going
from bscd.procedures.recording.clocks import ClockFit
from bscd.procedures.recording.ending import safe_ending
from bscd.procedures.recording.frame_times import FrameTimes
from bscd.procedures.recording.frames import BY_CAMERA, Exposure, NumberedFrames, SnappedFrames, StreamedFrames
from bscd.procedures.recording.pressure import PressureTrace, PressureWatch, come_to_rest
from bscd.procedures.recording.recipes import InflationRecipe
from bscd.procedures.recording.requirements import require_inflation
from bscd.procedures.recording.result import Ending, Recording
from bscd.procedures.recording.storing import Storing
from bscd.procedures.rehearsal import READOUT_RATE_PX_S
from bscd.procedures.rig import Rig
from bscd.procedures.taking import axes_of, send
from drivers.clock import VirtualClock
from drivers.errors import DeviceError
from drivers.interfaces import FrameStatus, PressureSource

#: Longest wait for a frame before the pressure and the operator are looked after again.
_SLICE_S = 0.1

#: The ramp stands still after so many frame times without a frame.
_LONGEST_GAP_FRAMES = 4

#: How long the disk may take for a frame in virtual time.
_DISK_S = 60.0


def record_inflation(
    rig: Rig,
    recipe: InflationRecipe,
    path: str | Path,
    *,
    title: str = "inflation",
    config_text: str = "",
    storing: Storing | None = None,
    followers: Sequence[Follower] = (),
    progress: ProgressCallback | None = None,
    stop: threading.Event | None = None,
) -> Recording:
    """Record an inflation into a new run file: each frame with the pressure in the middle of its exposure.

    Frames are streamed at the recipe's rate through a ring; ``followers`` get them as well. Every exposure is in the
    file or in its account of losses, with the reason. However it ends the membrane is vented, the axes are at rest and
    the file is readable. In virtual time the computer counts as fast enough: the clock waits for the disk.

    Raises
    ------
    InputError
        The rig can not do it, or the file exists; nothing moved, no pressure was set.
    CheckFailedError
        The pressure did not come to rest, or went above its limit before the first frame.
    ProcedureStoppedError
        ``stop`` was set; looked at with every frame, and ten times a second without, from the first pressure on.
    BscdError
        The disk is full, gone or failed; what was written before is in the file.
    NotVentedError
        The vent failed; the message says what ended the recording before.
    drivers.errors.DeviceError
        A device failed, or the camera was silent or away for too long.
    """
    path, storing = Path(path), storing or Storing()
    require_inflation(rig, recipe, path, storing)
    source = rig.pressure
    if source is None:
        raise InputError("inflation: the rig has no pressure source; configure [devices.pressure]")
    info = source.info()
    camera = CameraMeta.from_info(rig.primary.info())
    writer = RunWriter(
        path,
        title=title,
        cameras={"primary": camera},
        config_text=config_text,
        recipe_text=recipe.model_dump_json(),
        axes=axes_of(rig),
        pressure=PressureMeta(info.limits_kpa, info.noise_kpa, info.vendor, info.model, info.serial),
        flush_every=max(1, round(storing.flush_s * recipe.frame_rate_hz)),
        compression=storing.compression,
        sync=storing.sync,
        reserve_bytes=storing.reserve_bytes,
    )
    begun_s = rig.clock.now_s()
    report = progress or (lambda _: None)
    with writer:
        require_going(stop, "inflation: before it began")
        with StreamSession(writer, camera, slots=storing.ring_frames, followers=followers) as session:
            with safe_ending(rig):
                send(rig.jacks, rig.raised_mm, writer, "jack")
                inflation = _Inflation(rig, recipe, source, session, report, stop)
                ending = inflation.run()
            if ending is Ending.COMPLETED:
                session.ended(recipe.frame_count, BY_CAMERA)
            else:
                session.recorder.event(inflation.watch.reason)
        frames = session.written
    return Recording(
        path=path,
        frames=frames,
        lost_frames=session.account.lost,
        incomplete_frames=inflation.incomplete,
        duration_s=rig.clock.now_s() - begun_s,
        ending=ending,
        reason=inflation.watch.reason,
        peak_fill=session.ring.peak_fill,
    )


class _Inflation:
    """One inflation from rest to its ending; the caller vents."""

    def __init__(
        self,
        rig: Rig,
        recipe: InflationRecipe,
        source: PressureSource,
        session: StreamSession,
        report: ProgressCallback,
        stop: threading.Event | None,
    ) -> None:
        self._rig = rig
        self._recipe = recipe
        self._source = source
        self._session = session
        self._report = report
        self._stop = stop
        self._trace = PressureTrace(source, session.recorder.log_pressure)
        self.watch = PressureWatch(recipe, source.info().noise_kpa)
        self.incomplete = 0
        self._ramp_s = 0.0
        self._raised_s: float | None = None

    def run(self) -> Ending:
        """Bring the pressure to rest, then record until something ends it."""
        rig, recipe = self._rig, self._recipe
        rig.primary.configure(exposure_s=recipe.exposure_s, gain_db=recipe.gain_db, frame_rate_hz=recipe.frame_rate_hz)
        self._source.set_pressure(recipe.rest_kpa)
        noise_kpa = self._source.info().noise_kpa
        come_to_rest(self._trace, self.watch, recipe, noise_kpa, rig.clock, self._stop)
        camera, status = rig.primary.info(), rig.primary.status()
        likely_s, period_s = camera.width_px * camera.height_px / READOUT_RATE_PX_S, 1.0 / recipe.frame_rate_hz
        fit = partial(ClockFit, status.exposure_s, recipe.readout_s, likely_s, period_s)
        self._times = FrameTimes(fit, period_s, self._session.recorder.event)
        self._known: dict[str, Any] = {
            "exposure_s": status.exposure_s,
            "gain_db": status.gain_db,
            "jack_mm": rig.jacks.status().position,
            "y_mm": rig.translation.status().position - rig.origin_mm,
            "rotation_deg": rig.rotation.status().position,
        }
        self._trace.read()
        paced = StreamedFrames if recipe.pacing == "hardware" else SnappedFrames
        try:
            return self._follow(paced(rig.primary, rig.clock, recipe.frame_rate_hz, recipe.away_s))
        finally:
            self._session.time_base = self._times.result()

    def _follow(self, frames: NumberedFrames) -> Ending:
        """Take frames until all are there or the pressure ends it, and raise the pressure with them."""
        count = self._recipe.frame_count
        while True:
            exposure = frames.next(_SLICE_S)
            done = self._session.account.acquired
            require_going(self._stop, f"inflation: after frame {done - 1}")
            self._session.require_writing()
            if exposure is None or exposure.number >= count:
                ending = self.watch.ending(self._trace.read())
                if ending is not None or exposure is not None:
                    return ending or Ending.COMPLETED
                continue
            ending = self._take(exposure)
            if ending is not None or exposure.number + 1 == count:
                return ending or Ending.COMPLETED
            self._raise_pressure(exposure.number)

    def _take(self, exposure: Exposure) -> Ending | None:
        """Publish a frame with its pressure; what the pressure ends the inflation with, if it does."""
        middle_ns, time_s = self._times.place(exposure)
        try:
            readings = self._trace.read()
        except DeviceError:
            self._publish(exposure, middle_ns, time_s)
            raise
        self._publish(exposure, middle_ns, time_s)
        self.incomplete += exposure.frame.status is not FrameStatus.OK
        told = ", ".join(filter(None, (f"{self._trace.latest_kpa:.2f} kPa", self._session.trouble)))
        self._report(Progress(exposure.number + 1, self._recipe.frame_count, told))
        return self.watch.ending(readings)

    def _publish(self, exposure: Exposure, middle_ns: int, time_s: float) -> None:
        frame = exposure.frame
        record = FrameRecord(
            camera="primary",
            phase="inflation",
            data=frame.data,
            frame_id=frame.frame_id,
            camera_time_ns=frame.camera_time_ns,
            host_time_ns=frame.host_time_ns,
            status=frame.status,
            pressure_kpa=self._trace.at_kpa(middle_ns),
            time_s=time_s,
            **self._known,
        )
        self._session.publish(exposure.number, record, exposure.reason)
        if isinstance(self._rig.clock, VirtualClock):
            self._session.recorder.wait_idle(_DISK_S)

    def _raise_pressure(self, number: int) -> None:
        """The set-point rises with the frames: it waits for a camera that is silent, and goes on from where it was."""
        if number + 1 >= self._recipe.rest_frames:
            now_s = self._rig.clock.now_s()
            if self._raised_s is not None:
                self._ramp_s += min(now_s - self._raised_s, _LONGEST_GAP_FRAMES / self._recipe.frame_rate_hz)
            self._raised_s = now_s
            self._source.set_pressure(self._recipe.set_point_kpa(self._ramp_s))
