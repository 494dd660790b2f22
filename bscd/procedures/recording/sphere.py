"""Record a sphere: through the biprism, then with the standard pair (paper, section 2.2.3)."""

from __future__ import annotations

import threading
from pathlib import Path

from bscd.acquisition import CameraMeta, FrameRecord, RunWriter
from bscd.procedures.progress import Progress, ProgressCallback, require_going
from bscd.procedures.recording.recipes import SphereRecipe
from bscd.procedures.recording.requirements import require_sphere
from bscd.procedures.recording.result import Recording
from bscd.procedures.rig import CameraRole, Rig
from bscd.procedures.taking import axes_of, send, whole_frame


def record_sphere(
    rig: Rig,
    recipe: SphereRecipe,
    path: str | Path,
    *,
    title: str = "sphere",
    config_text: str = "",
    progress: ProgressCallback | None = None,
    stop: threading.Event | None = None,
) -> Recording:
    """Record a sphere that stands in the volume into a new run file; the stages stay where they are.

    The biprism is raised first, so that it has not moved since a calibration where it is raised already. However it
    ends, the axes are at rest and the file is readable.

    Raises
    ------
    InputError
        The rig can not do it, or the file exists; nothing moved.
    CheckFailedError
        A camera's frames came incomplete.
    ProcedureStoppedError
        ``stop`` was set; checked between the two heights.
    drivers.errors.DeviceError
        A device failed.
    """
    path = Path(path)
    require_sphere(rig, recipe, path)
    parts: list[tuple[float, tuple[CameraRole, ...]]] = [(rig.raised_mm, ("primary",))]
    if recipe.standard_pair:
        parts.append((rig.lowered_mm, ("primary", "auxiliary")))
    writer = RunWriter(
        path,
        title=title,
        cameras={role: CameraMeta.from_info(rig.cameras[role].info()) for role in parts[-1][1]},
        config_text=config_text,
        recipe_text=recipe.model_dump_json(),
        axes=axes_of(rig),
    )
    begun_s = rig.clock.now_s()
    report = progress or (lambda _: None)
    try:
        with writer:
            for role in parts[-1][1]:
                rig.cameras[role].configure(exposure_s=recipe.exposure_s, gain_db=recipe.gain_db)
            for number, (height_mm, roles) in enumerate(parts):
                require_going(stop, f"sphere: before the biprism at {height_mm:g} mm")
                report(Progress(number, len(parts), f"biprism at {height_mm:g} mm"))
                send(rig.jacks, height_mm, writer, "jack")
                rig.clock.sleep(recipe.settle_s)
                for _ in range(recipe.frames):
                    for role in roles:
                        writer.append(_exposed(rig, role))
            frames = writer.frames_written
    finally:
        rig.stop_axes()
    report(Progress(len(parts), len(parts), "done"))
    return Recording(path, frames, 0, 0, rig.clock.now_s() - begun_s)


def _exposed(rig: Rig, role: CameraRole) -> FrameRecord:
    status = rig.cameras[role].status()
    jack_mm = rig.jacks.status().position
    frame = whole_frame(rig, role, status.exposure_s)
    return FrameRecord(
        camera=role,
        phase="sphere",
        data=frame.data,
        frame_id=frame.frame_id,
        camera_time_ns=frame.camera_time_ns,
        host_time_ns=frame.host_time_ns,
        jack_mm=jack_mm,
        exposure_s=status.exposure_s,
        gain_db=status.gain_db,
    )
