"""What every recording does with a rig: send an axis, take a whole frame, describe the axes for the run file."""

from __future__ import annotations

from collections.abc import Mapping

from bscd.acquisition import AxisMeta, AxisName, RunWriter
from bscd.errors import CheckFailedError
from bscd.procedures.rig import AxisRole, CameraRole, Rig
from drivers.interfaces import Axis, Frame, FrameStatus

_TRIES_PER_FRAME = 3

#: Beyond an exposure, how long a frame may take.
TIMEOUT_MARGIN_S = 5.0

#: The axes of a run file by the rig's.
RUN_AXES: Mapping[AxisName, AxisRole] = {"jack": "jacks", "translation": "translation", "rotation": "rotation"}


def send(axis: Axis, position: float, writer: RunWriter, name: AxisName) -> None:
    """Move an axis (its own unit) unless it is there, and keep where it was sent."""
    writer.set_target(name, position)
    if abs(axis.status().position - position) > axis.info().resolution / 2.0:
        axis.move_to(position)


def whole_frame(rig: Rig, role: CameraRole, exposure_s: float) -> Frame:
    """A single frame that came whole. Raises `CheckFailedError` when three in a row did not."""
    for _ in range(_TRIES_PER_FRAME):
        frame = rig.cameras[role].snap(timeout_s=exposure_s + TIMEOUT_MARGIN_S)
        if frame.status is FrameStatus.OK:
            return frame
    raise CheckFailedError(f"{role} camera: {_TRIES_PER_FRAME} frames in a row came incomplete; check its cable")


def axes_of(rig: Rig) -> dict[AxisName, AxisMeta]:
    """The rig's axes as a run file describes them."""
    return {name: _axis_meta(rig, name) for name in RUN_AXES}


def _axis_meta(rig: Rig, name: AxisName) -> AxisMeta:
    info = rig.axes[RUN_AXES[name]].info()
    return AxisMeta(
        unit="deg" if name == "rotation" else "mm",
        origin=rig.origin_mm if name == "translation" else 0.0,
        limits=info.limits,
        tolerance=info.repeatability,
        vendor=info.vendor,
        model=info.model,
        serial=info.serial,
    )
