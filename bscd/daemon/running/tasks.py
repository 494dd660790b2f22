"""What is done at the desk, in a process of its own: its orders, and what it tells meanwhile."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bscd.calibration.choices import CalibrationChoices
from bscd.procedures.measuring.settings import MeasureSettings


@dataclass(frozen=True)
class CalibrateTask:
    """Calibrate from two runs into ``out``; hold it against ``validation`` where there is one."""

    reference: Path
    bsc: Path
    out: Path
    choices: CalibrationChoices
    validation: Path | None = None


@dataclass(frozen=True)
class MeasureTask:
    """Measure a run into ``out``; ``report`` is the folder of a report, ``sphere_radius_mm`` of a fit that is held."""

    calibration: Path
    run: Path
    out: Path
    settings: MeasureSettings = field(default_factory=MeasureSettings)
    report: Path | None = None
    sphere_radius_mm: float | None = None


DeskTask = CalibrateTask | MeasureTask


@dataclass(frozen=True)
class DeskWarning:
    """Something worth knowing; it goes on."""

    text: str


@dataclass(frozen=True)
class DeskDone:
    """It is done; ``figures`` with units in their names."""

    figures: dict[str, Any]


@dataclass(frozen=True)
class DeskFailure:
    """It ended: ``text`` is for the operator, ``stopped`` whether because it was asked to."""

    text: str
    stopped: bool = False


@dataclass(frozen=True)
class DeskStop:
    """An order to end, and to keep what can be kept."""
