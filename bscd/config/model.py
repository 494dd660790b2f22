"""The sections of a rig's configuration; every key has its unit in its name and its meaning in its description."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bscd.calibration.choices import CalibrationChoices
from bscd.calibration.target import GridTarget, PointsTarget
from bscd.errors import InputError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Section(BaseModel):
    """A section of the file: frozen; unknown keys, and text or true for a number, are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


def _odd(value: int, name: str) -> None:
    if value % 2 == 0:
        raise ValueError(f"{name} must be odd, so that it has a middle")


class RigSection(Section):
    """What this rig is called."""

    name: str = Field(default="bscd rig", min_length=1, description="name of the rig, for reports")
    notes: str = Field(default="", description="anything worth keeping with every run")


class TargetConfig(Section):
    """The calibration target: the cube with a dot grid, or a body with surveyed marks."""

    kind: Literal["grid", "points"] = Field(default="grid", description="a dot grid on a cube, or a table of marks")
    columns: int = Field(default=9, ge=2, le=200, description="dot columns on a face")
    rows: int = Field(default=23, ge=2, le=200, description="dot rows on a face")
    pitch_mm: Positive = Field(default=2.0, description="distance of neighbouring dots, mm")
    dot_diameter_mm: Positive = Field(default=1.0, description="diameter of a dot, mm")
    margin_mm: Positive = Field(default=2.0, description="from the cube's edge to the first dot column, mm")
    table: str = Field(default="", description="kind = points: CSV file with label,x_mm,y_mm,z_mm, beside this file")
    mark_size_mm: Positive = Field(default=5.0, description="kind = points: size of a mark, mm")

    @model_validator(mode="after")
    def _possible(self) -> TargetConfig:
        if self.kind == "points" and not self.table:
            raise ValueError('table must name a CSV file for kind = "points"')
        if self.kind == "grid" and self.dot_diameter_mm >= 0.8 * self.pitch_mm:
            raise ValueError(f"dot_diameter_mm must be below 0.8 pitch_mm = {0.8 * self.pitch_mm:g}, or dots touch")
        return self

    def grid(self) -> GridTarget:
        """The cube. Raises `InputError` for a target of marks."""
        if self.kind != "grid":
            raise InputError('[target] kind = "points": this procedure needs the cube, kind = "grid"')
        return GridTarget(self.columns, self.rows, self.pitch_mm, self.dot_diameter_mm, self.margin_mm)

    def points(self, folder: Path) -> PointsTarget:
        """The surveyed marks, from the table in ``folder``. Raises `InputError` for a table it can not use."""
        path = folder / self.table
        try:
            rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
            xyz = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
            labels = tuple(row["label"] for row in rows)
        except (OSError, KeyError, ValueError, TypeError) as err:
            raise InputError(
                f"{path}: not a table of marks with label,x_mm,y_mm,z_mm in its first line ({err})"
            ) from err
        if len(set(labels)) != len(labels) or len(labels) < 6 or not np.isfinite(xyz).all():
            raise InputError(f"{path}: needs at least 6 marks with finite positions and labels of their own")
        return PointsTarget(labels, xyz, self.mark_size_mm)


class SphereConfig(Section):
    """A sphere to check the measurement on."""

    radius_mm: Positive = Field(default=18.265, description="nominal radius, mm")


class MembraneConfig(Section):
    """The inflated membrane."""

    radius_mm: Positive = Field(default=15.0, description="radius of the clamped window, mm")


class PrismConfig(Section):
    """The biprism and the jack heights that bring it into view and out of it."""

    refractive_index: float = Field(default=1.4585, gt=1.0, lt=3.0, description="at the light's wavelength")
    alpha_deg: float = Field(default=161.4, gt=90.0, lt=180.0, description="apex angle of the roof, deg")
    thickness_mm: Positive = Field(default=30.0, description="back face to roof edge, mm")
    raised_mm: NotNegative = Field(default=70.0, description="height of the lab jacks, prism in view, mm")
    lowered_mm: NotNegative = Field(default=5.0, description="height of the lab jacks, prism out of view, mm")

    @model_validator(mode="after")
    def _apart(self) -> PrismConfig:
        if self.lowered_mm >= self.raised_mm:
            raise ValueError(f"lowered_mm = {self.lowered_mm:g} must be below raised_mm = {self.raised_mm:g}")
        return self


class LightConfig(Section):
    """The illumination, kept with every run."""

    wavelength_nm: Positive = Field(default=630.0, description="centre of the filter, nm")
    bandwidth_nm: Positive = Field(default=20.0, description="width of the filter, nm")
    description: str = Field(default="", description="lamps and filter in words")


class LensConfig(Section):
    """The cameras' lens in words, for reports."""

    description: str = Field(default="", description="maker, model and focal length")
    aperture: str = Field(default="", description="f-number, as it was set")


class PatternConfig(Section):
    """The speckle pattern, for reports."""

    technique: str = Field(default="", description="how the pattern was made, in words")


class ScanConfig(Section):
    """The calibration scans."""

    positions: int = Field(default=17, ge=5, le=201, description="positions along y, odd: POS.0 is the middle")
    step_mm: Positive = Field(default=2.0, description="distance of neighbouring positions, mm")
    frames_per_position: int = Field(default=2, ge=1, le=1000, description="frames averaged at a position")
    poses: tuple[Literal["face", "corner"], ...] = Field(
        default=("face",), strict=False, description='poses that are scanned; "corner" widens the calibrated volume'
    )
    corner_rotation_deg: Finite = Field(default=45.0, description="rotation reading, edge towards the camera, deg")
    face_rotation_deg: Finite = Field(default=0.0, description="rotation reading, right face to the camera, deg")
    origin_mm: Finite = Field(default=50.0, description="translation reading at POS.0, mm")
    settle_s: NotNegative = Field(default=0.2, description="wait after a move before a frame, s")
    exposure_s: Positive = Field(default=0.02, description="exposure of both cameras, s")
    gain_db: Finite = Field(default=0.0, description="gain of both cameras, dB")

    @model_validator(mode="after")
    def _possible(self) -> ScanConfig:
        _odd(self.positions, "positions")
        if sorted(self.poses) not in (["face"], ["corner", "face"]):
            raise ValueError('poses must be ["face"] or ["face", "corner"]')
        if abs(self.corner_rotation_deg - self.face_rotation_deg) < 1.0:
            raise ValueError("corner_rotation_deg and face_rotation_deg must differ")
        return self


class CalibrationConfig(Section):
    """How a calibration is made from the scans."""

    reference: Literal["lattice", "raw"] = Field(default="lattice", description="source of the reference points P^T")
    solver: Literal["projection", "smallest"] = Field(default="projection", description="how image shifts are found")
    interpolant: Literal["smooth", "linear"] = Field(default="smooth", description="how the maps fill the volume")
    triangulation: Literal["optimal", "linear"] = Field(default="optimal", description="how points are triangulated")
    degree: int = Field(default=4, ge=1, le=4, description="total degree of the smooth maps")

    def choices(self) -> CalibrationChoices:
        """The same for `bscd.calibration`."""
        return CalibrationChoices(**self.model_dump())


class DicConfig(Section):
    """Digital image correlation."""

    subset_px: int = Field(default=21, ge=5, le=201, description="edge of a subset, odd, px")
    search_px: int = Field(default=41, ge=7, le=1001, description="edge of the search window, odd, px")
    step_px: int = Field(default=10, ge=1, le=1000, description="distance of measured points, px")

    @model_validator(mode="after")
    def _possible(self) -> DicConfig:
        _odd(self.subset_px, "subset_px")
        _odd(self.search_px, "search_px")
        if self.search_px <= self.subset_px:
            raise ValueError(f"search_px must be above subset_px = {self.subset_px}")
        return self


class DeviceConfig(Section):
    """A device: the driver's name and the options that this driver knows, validated by its own model."""

    driver: str = Field(description='name in the registry, for example "camera.simulated"')
    options: Any = Field(default=None, description="the driver's validated options")


class DevicesConfig(Section):
    """The rig's devices; leave out what the rig does not have."""

    primary: DeviceConfig
    auxiliary: DeviceConfig | None = None
    rotation: DeviceConfig
    translation: DeviceConfig
    jacks: DeviceConfig
    pressure: DeviceConfig | None = None


class DaemonConfig(Section):
    """The daemon: where it listens, where its data goes, what it lets through."""

    data_folder: str = Field(
        default="data", min_length=1, description="runs, calibrations, results, journal; relative: beside this file"
    )
    host: str = Field(default="127.0.0.1", min_length=1, description="address; any but loopback needs keys")
    port: int = Field(default=8080, ge=0, le=65535, description="of page and API; 0: a free one")
    estop_port: int = Field(default=8081, ge=0, le=65535, description="of the e-stop's own listener; 0: a free one")
    keys_file: str = Field(default="keys.json", min_length=1, description="hashed API keys, in the data folder")
    lease_s: Positive = Field(default=60.0, description="how long control of the rig lasts unless renewed, s")
    request_limit_bytes: int = Field(default=1_000_000, ge=1000, description="largest body of a request")
    requests_per_s: Positive = Field(default=50.0, description="requests of one client, on average")
    reserve_mb: NotNegative = Field(default=2000.0, description="disk space that no job may use, MB")
    queue_limit: int = Field(default=20, ge=1, le=1000, description="jobs that may wait")
    poll_s: Positive = Field(default=0.5, description="between two looks at idle devices, s")
    confirm_timeout_s: Positive = Field(default=3600.0, description="how long an operator may take to answer, s")


class TargetFile(Section):
    """A rig.toml beside an import's manifest: what was imaged, and what a report should say of the setup."""

    target: TargetConfig = TargetConfig()
    sphere: SphereConfig | None = None
    membrane: MembraneConfig | None = None
    lens: LensConfig | None = None
    light: LightConfig | None = None
    pattern: PatternConfig | None = None


class RigConfig(Section):
    """The whole file."""

    rig: RigSection = RigSection()
    target: TargetConfig = TargetConfig()
    sphere: SphereConfig = SphereConfig()
    membrane: MembraneConfig = MembraneConfig()
    prism: PrismConfig = PrismConfig()
    light: LightConfig = LightConfig()
    lens: LensConfig = LensConfig()
    pattern: PatternConfig = PatternConfig()
    scan: ScanConfig = ScanConfig()
    calibration: CalibrationConfig = CalibrationConfig()
    dic: DicConfig = DicConfig()
    daemon: DaemonConfig = DaemonConfig()
    devices: DevicesConfig
    twin: Any = Field(default=None, description="the digital twin that simulated devices see")
