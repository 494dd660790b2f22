"""What the registry knows of the XIMC stages."""

from __future__ import annotations

from drivers.registry import DriverContext, DriverEntry
from drivers.stages.axis import StageAxis
from drivers.stages.ximc.controller import XimcController
from drivers.stages.ximc.options import XimcOptions


def _build(options: XimcOptions, context: DriverContext) -> StageAxis:
    return StageAxis(context.name, options, XimcController(options), context.clock)


AXIS = DriverEntry("axis", XimcOptions, _build, "a Standa stage on an XIMC controller (8SMC4, 8SMC5)")
