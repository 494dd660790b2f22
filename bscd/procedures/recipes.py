"""Recipes of scans: which poses and positions, how many frames; they validate, iterate and estimate themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from bscd.acquisition.names import PhaseName
from bscd.calibration.observations import PoseName

ScanKind = Literal["reference", "bsc"]
Finite = Annotated[float, Field(allow_inf_nan=False)]

_PHASES: dict[tuple[ScanKind, PoseName], PhaseName] = {
    ("reference", "corner"): "reference-corner",
    ("reference", "face"): "reference-face",
    ("bsc", "corner"): "bsc-corner",
    ("bsc", "face"): "bsc-face",
}


@dataclass(frozen=True)
class ScanStep:
    """One place of the target: pose, k of POS.k, displacement from POS.0, rotation.

    The places of a validation scan are numbered on beyond the last POS.k, so that none passes for one.
    """

    pose: PoseName
    position: int
    y_mm: float
    rotation_deg: float
    phase: PhaseName

    def __str__(self) -> str:
        """The place in words."""
        return f"{self.pose} pose, POS.{self.position:+d} (y = {self.y_mm:+g} mm)"


class ScanRecipe(BaseModel):
    """A scan of the target through the measurement volume (paper, sections 2.2.1 and 2.2.2).

    A calibration scan images the corner at POS.0, then every pose of ``poses`` through all positions. With
    ``y_offsets_mm`` it is a validation scan: every pose of ``poses`` at these displacements, nothing else.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: ScanKind = Field(description="reference: biprism lowered, both cameras; bsc: raised, primary only")
    positions: int = Field(17, ge=1, le=401, description="positions, an odd number, evenly about POS.0")
    step_mm: float = Field(2.0, gt=0.0, allow_inf_nan=False, description="distance between positions, mm")
    frames_per_position: int = Field(2, ge=1, le=1000, description="frames of a camera at a position")
    poses: tuple[PoseName, ...] = Field(("face",), min_length=1, description="poses that go through all positions")
    corner_rotation_deg: Finite = Field(45.0, description="rotation stage's reading in the corner pose, deg")
    face_rotation_deg: Finite = Field(0.0, description="rotation stage's reading in the face pose, deg")
    settle_s: float = Field(0.2, ge=0.0, le=60.0, description="wait after a move, s")
    exposure_s: float | None = Field(None, gt=0.0, le=60.0, description="exposure of both cameras, s; none: as set")
    gain_db: Finite | None = Field(None, description="gain of both cameras, dB; none: as set")
    y_offsets_mm: tuple[Finite, ...] = Field((), description="validation: displacements from POS.0, mm")
    rotation_offset_deg: Finite = Field(0.0, ge=-20.0, le=20.0, description="added to both poses' rotation, deg")

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.positions % 2 == 0:
            raise ValueError(f"positions = {self.positions} must be odd, so that POS.0 is the middle one")
        if len(set(self.poses)) < len(self.poses):
            raise ValueError("poses names one twice")
        if self.corner_rotation_deg == self.face_rotation_deg:
            raise ValueError("corner_rotation_deg and face_rotation_deg are equal; the poses are 45 deg apart")
        if len(set(self.y_offsets_mm)) < len(self.y_offsets_mm):
            raise ValueError("y_offsets_mm names a displacement twice")
        if self.rotation_offset_deg and not self.y_offsets_mm:
            raise ValueError("rotation_offset_deg is for validation scans: give y_offsets_mm with it")
        return self

    @property
    def validates(self) -> bool:
        """Whether this is a validation scan, off the calibrated positions."""
        return bool(self.y_offsets_mm)

    @property
    def camera_roles(self) -> tuple[Literal["primary", "auxiliary"], ...]:
        """The cameras that take part."""
        return ("primary", "auxiliary") if self.kind == "reference" else ("primary",)

    def steps(self) -> tuple[ScanStep, ...]:
        """The places in the order of the scan: the corner before the face, each towards growing y."""
        return tuple(self._iterate())

    @property
    def frame_count(self) -> int:
        """Frames of all cameras together."""
        return len(self.steps()) * len(self.camera_roles) * self.frames_per_position

    def between(self, rotation_offset_deg: float = 3.0) -> ScanRecipe:
        """The validation scan that belongs to this one: bsc, half-way between its positions, turned a little."""
        half = (self.positions - 1) / 2.0
        offsets = tuple((k + 0.5 - half) * self.step_mm for k in range(self.positions - 1))
        if not offsets:
            raise ValueError("a scan of one position has no positions between")
        given = self.model_dump(exclude={"kind", "y_offsets_mm", "rotation_offset_deg"})
        return ScanRecipe(kind="bsc", y_offsets_mm=offsets, rotation_offset_deg=rotation_offset_deg, **given)

    def _iterate(self) -> Iterator[ScanStep]:
        half = self.positions // 2
        for pose in ("corner", "face"):
            if self.validates:
                if pose in self.poses:
                    for number, y_mm in enumerate(sorted(self.y_offsets_mm), start=half + 1):
                        yield self._step(pose, number, y_mm)
                continue
            scanned = range(-half, half + 1) if pose in self.poses else range(1) if pose == "corner" else ()
            for position in scanned:
                yield self._step(pose, position, position * self.step_mm)

    def _step(self, pose: PoseName, position: int, y_mm: float) -> ScanStep:
        rotation_deg = (
            self.corner_rotation_deg if pose == "corner" else self.face_rotation_deg
        ) + self.rotation_offset_deg
        return ScanStep(pose, position, y_mm, rotation_deg, _PHASES[self.kind, pose])
