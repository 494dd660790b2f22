"""What must hold before anything moves: over a whole recipe, and over a campaign's steps one after the other."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bscd.daemon.bench import Bench
from bscd.daemon.documents import ValidationDocument
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.files import DataFolder, FileKind
from bscd.daemon.recipes import (
    Align,
    BscScan,
    Calibrate,
    Campaign,
    Home,
    Inflation,
    Measure,
    Move,
    Recipe,
    ReferenceScan,
    SphereCheck,
)
from bscd.daemon.running.work import scan_defaults
from bscd.errors import BscdError
from bscd.procedures import dry_run
from bscd.procedures.recording.requirements import inflation_problems, sphere_problems
from bscd.procedures.rehearsal import axis_problems, axis_targets, bytes_per_frame
from drivers.errors import DeviceError


@dataclass
class _Looked:
    """What was found so far, and what earlier steps will have done."""

    homed: bool = False
    made: dict[str, set[FileKind]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    frames: int = 0
    disk_bytes: int = 0
    duration_s: float = 0.0
    timed: bool = True
    positions: dict[str, list[float]] = field(default_factory=dict)

    def send(self, positions: Mapping[str, Iterable[float]]) -> None:
        for role, values in positions.items():
            self.positions.setdefault(role, []).extend(values)

    def takes(self, duration_s: float) -> None:
        if duration_s != duration_s:
            self.timed = False
        else:
            self.duration_s += duration_s


#: What each recipe leaves behind.
MAKES: Mapping[type[Recipe], tuple[FileKind, ...]] = {
    ReferenceScan: ("run",),
    BscScan: ("run",),
    SphereCheck: ("run", "result", "report"),
    Inflation: ("run", "result"),
    Calibrate: ("calibration",),
    Measure: ("result", "report"),
}


class Interlocks:
    """Looks at recipes; moves nothing. ``reserve_bytes`` of the disk no job may use."""

    def __init__(self, bench: Bench, files: DataFolder, reserve_bytes: int) -> None:
        self._bench, self._files, self._reserve_bytes = bench, files, reserve_bytes
        self._looks: dict[type[Recipe], Callable[[Any, _Looked], None]] = {
            Home: self._home,
            Move: self._move,
            Align: self._align,
            ReferenceScan: self._scan,
            BscScan: self._scan,
            SphereCheck: self._sphere,
            Inflation: self._inflation,
            Calibrate: self._calibrate,
            Measure: self._measure,
        }

    def look(self, recipe: Recipe, *, homed: bool = False, first_step: int = 0) -> ValidationDocument:
        """What a recipe would take; ``homed``: the axes will be homed before. A campaign from ``first_step`` on."""
        looked = _Looked(homed=homed)
        if isinstance(recipe, Campaign):
            for number, step in enumerate(recipe.steps):
                if number >= first_step:
                    self._one(step.do, looked, f"step {number + 1} ({step.name}): ")
                kinds = set(MAKES.get(type(step.do), ()))
                if isinstance(step.do, Inflation) and step.do.calibration is None:
                    kinds.discard("result")
                looked.made[step.name] = kinds
        else:
            if isinstance(recipe, Calibrate | Measure) and (recipe.prompt or recipe.specimen):
                looked.problems.append(
                    f"{recipe.recipe}: is done at the desk, where nobody is asked and nothing is placed; "
                    "leave out prompt and specimen, or make it a step of a campaign"
                )
            self._one(recipe, looked, "")
        free = shutil.disk_usage(self._files.root).free
        if looked.disk_bytes + self._reserve_bytes > free:
            looked.problems.append(
                f"it needs {looked.disk_bytes / 1e6:.0f} MB beyond the reserve of {self._reserve_bytes / 1e6:.0f} MB, "
                f"the disk has {free / 1e6:.0f} MB free; remove old runs or lower [daemon] reserve_mb"
            )
        return ValidationDocument(
            ok=not looked.problems,
            problems=tuple(dict.fromkeys(looked.problems)),
            frames=looked.frames,
            duration_s=looked.duration_s if looked.timed else None,
            disk_bytes=looked.disk_bytes,
            limits=self._limits(looked),
        )

    def _one(self, recipe: Recipe, looked: _Looked, where: str) -> None:
        before = len(looked.problems)
        try:
            self._looks[type(recipe)](recipe, looked)
        except (BscdError, DeviceError, ValueError) as error:
            looked.problems.append(str(error))
        looked.problems[before:] = [f"{where}{problem}" for problem in looked.problems[before:]]

    def _limits(self, looked: _Looked) -> dict[str, dict[str, float]]:
        told: dict[str, dict[str, float]] = {}
        for role, axis in self._bench.rig.axes.items():
            if positions := looked.positions.get(role):
                limits = axis.info().limits
                told[role] = {
                    "least": min(positions),
                    "greatest": max(positions),
                    "low_limit": limits.low,
                    "high_limit": limits.high,
                }
        return told

    def _connected(self, looked: _Looked, names: Iterable[str]) -> bool:
        lost = self._bench.lost(names)
        looked.problems += [f"{name}: is not connected; connect the rig" for name in lost]
        return not lost

    def _home(self, recipe: Home, looked: _Looked) -> None:
        self._connected(looked, self._bench.rig.axes)
        looked.homed, looked.timed = True, False

    def _move(self, recipe: Move, looked: _Looked) -> None:
        axis = self._bench.rig.axes[recipe.axis]
        if self._connected(looked, [recipe.axis]):
            looked.problems += axis_problems(recipe.axis, axis, [recipe.position], homed=looked.homed)
            looked.send({recipe.axis: [recipe.position]})
            if not looked.problems and not looked.homed:
                looked.takes(axis.move_duration_s(recipe.position))

    def _align(self, recipe: Align, looked: _Looked) -> None:
        rig, config = self._bench.rig, self._bench.config
        names = ["primary"] if recipe.view == "biprism" else ["primary", "auxiliary"]
        looked.problems += [f"the {name} camera is missing" for name in names if name not in rig.cameras]
        if not self._connected(looked, [*names, *rig.axes]):
            return
        angle = config.scan.corner_rotation_deg if recipe.pose == "corner" else config.scan.face_rotation_deg
        height = rig.raised_mm if recipe.view == "biprism" else rig.lowered_mm
        targets = {"jacks": [height], "translation": [rig.origin_mm], "rotation": [angle]}
        for role, positions in targets.items():
            looked.problems += axis_problems(role, getattr(rig, role), positions, homed=looked.homed)
        looked.send(targets)
        looked.timed = False

    def _scan(self, recipe: ReferenceScan | BscScan, looked: _Looked) -> None:
        rig = self._bench.rig
        scan = recipe.scan(scan_defaults(self._bench.config))
        if isinstance(recipe, BscScan) and recipe.between:
            scan = scan.between()
        self._bench.config.target.grid()
        if not self._connected(looked, [*scan.camera_roles, *rig.axes]):
            return
        would = dry_run(rig, scan, homed=looked.homed)
        looked.problems += would.problems
        looked.frames += would.frames
        looked.disk_bytes += would.disk_bytes
        looked.takes(would.duration_s)
        looked.send({str(role): values for role, values in axis_targets(rig, scan, would.steps).items()})

    def _sphere(self, recipe: SphereCheck, looked: _Looked) -> None:
        rig, sphere = self._bench.rig, recipe.sphere
        self._named(looked, "calibration", recipe.calibration)
        if not self._connected(looked, ["primary", "auxiliary", "jacks"]):
            return
        looked.problems += sphere_problems(rig, sphere, self._files.root / "sphere.h5", homed=looked.homed)
        heights = [rig.raised_mm, rig.lowered_mm] if sphere.standard_pair else [rig.raised_mm]
        frames = sphere.frames * (3 if sphere.standard_pair else 1)
        looked.frames += frames
        looked.disk_bytes += frames * bytes_per_frame(rig.primary)
        looked.send({"jacks": heights})
        looked.timed = False

    def _inflation(self, recipe: Inflation, looked: _Looked) -> None:
        rig, inflation = self._bench.rig, recipe.inflation
        if recipe.calibration is not None:
            self._named(looked, "calibration", recipe.calibration)
        if not self._connected(looked, ["primary", "jacks", "pressure"]):
            return
        looked.problems += inflation_problems(rig, inflation, self._files.root / "run.h5", homed=looked.homed)
        looked.frames += inflation.frame_count
        looked.disk_bytes += inflation.frame_count * bytes_per_frame(rig.primary)
        looked.takes(inflation.frame_count / inflation.frame_rate_hz + inflation.rest_settle_s)
        looked.send({"jacks": [rig.raised_mm]})

    def _calibrate(self, recipe: Calibrate, looked: _Looked) -> None:
        for name in (recipe.reference, recipe.bsc, recipe.validation):
            if name is not None:
                self._named(looked, "run", name)
        looked.timed = False

    def _measure(self, recipe: Measure, looked: _Looked) -> None:
        self._named(looked, "calibration", recipe.calibration)
        self._named(looked, "run", recipe.run)
        looked.timed = False

    def _named(self, looked: _Looked, kind: FileKind, name: str) -> None:
        if kind in looked.made.get(name, ()):
            return
        if name in looked.made:
            looked.problems.append(f"step {name} makes no {kind}; name one that does")
            return
        try:
            self._files.path(kind, name)
        except UnknownNameError as error:
            looked.problems.append(str(error))
