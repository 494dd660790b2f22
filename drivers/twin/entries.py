"""What the registry knows of the digital twin: the world that simulated devices share."""

from __future__ import annotations

from drivers.registry import DriverContext, DriverEntry
from drivers.twin.options import TwinOptions
from drivers.twin.world import World


def _build_world(options: TwinOptions, context: DriverContext) -> World:
    return World(options, clock=context.clock)


WORLD = DriverEntry("world", TwinOptions, _build_world, "the digital twin that simulated devices see and move")
