"""What a stage's controller must do for `drivers.stages.axis.StageAxis`; positions are whole microsteps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answers."""

    vendor: str
    model: str
    serial: str
    firmware: str = ""


@dataclass(frozen=True, slots=True)
class MotorState:
    """What the controller tells, all of the same instant."""

    count: int
    """Position, microsteps."""
    moving: bool
    homed: bool
    fault: str
    """Its alarms in words; empty when there is none."""
    interrupted: bool
    """The last motion was ended by a stop."""
    failed: bool = False
    """The last motion ended in an error."""


class StageController(Protocol):
    """A controller; its methods raise the errors of `drivers.stages.line` and may be called from any thread."""

    microsteps_per_unit: float
    """Counts per mm or deg of the axis, negative for one that is reversed."""
    longest_homing_s: float
    """Seconds that a homing may take."""
    longest_approach_s: float
    """Seconds that a move may take beyond its distance, for the care of backlash."""

    def open(self) -> Identity:
        """Open the line, give the device its settings, and tell who it is; moves nothing."""
        ...

    def close(self) -> None:
        """Give the line free; never raises, may be called twice."""
        ...

    def state(self) -> MotorState:
        """State now."""
        ...

    def prepare(self) -> bool:
        """Make ready for a motion; False when the device was switched off in between."""
        ...

    def begin_move(self, count: int) -> None:
        """Set off to a position."""
        ...

    def begin_home(self) -> None:
        """Set off to the reference."""
        ...

    def end_home(self) -> None:
        """Give the reference its position, at rest on it."""
        ...

    def halt(self) -> None:
        """Decelerate to rest, at once."""
        ...
