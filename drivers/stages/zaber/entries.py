"""What the registry knows of the Zaber stages."""

from __future__ import annotations

from drivers.registry import DriverContext, DriverEntry
from drivers.stages.axis import StageAxis
from drivers.stages.zaber.controller import ZaberController
from drivers.stages.zaber.options import ZaberOptions


def _build(options: ZaberOptions, context: DriverContext) -> StageAxis:
    return StageAxis(context.name, options, ZaberController(options), context.clock)


AXIS = DriverEntry("axis", ZaberOptions, _build, "a Zaber stage (ASCII protocol)")
