"""What can be asked of the daemon: each recipe is a frozen, validated model, told apart by its ``recipe``."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from bscd.acquisition.names import Compression
from bscd.procedures.recipes import Finite, ScanRecipe
from bscd.procedures.recording.recipes import InflationRecipe, SphereRecipe

#: Names of files in the data folder, without their ending; nothing in one can lead out of it.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,119}$")]
Specimen = Literal["cube", "sphere", "membrane"]


class Recipe(BaseModel):
    """What all recipes have: a question to the operator before they begin, and what must stand in the volume."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    prompt: str = Field(default="", max_length=500, description="what the operator confirms first; empty: nothing")
    specimen: Specimen | None = Field(
        default=None, description="what must stand in the volume; the operator confirms it, the twin places it itself"
    )


class Home(Recipe):
    """Home every axis that does not know where it is, or every axis (``again``)."""

    recipe: Literal["home"] = "home"
    again: bool = False


class Move(Recipe):
    """Send one axis to a reading, in its unit (mm, deg)."""

    recipe: Literal["move"] = "move"
    axis: Literal["rotation", "translation", "jacks"]
    position: Finite


class Align(Recipe):
    """Look at the cube and say what to turn: through the biprism, or between the two cameras."""

    recipe: Literal["align"] = "align"
    view: Literal["biprism", "cameras"] = "biprism"
    pose: Literal["corner", "face"] = "corner"
    frames: int = Field(default=4, ge=1, le=100, description="frames that are averaged")


class _Scan(Recipe):
    kind: ClassVar[Literal["reference", "bsc"]]

    positions: int | None = Field(default=None, ge=1, le=401, description="positions, odd; none: as configured")
    step_mm: float | None = Field(default=None, gt=0.0, allow_inf_nan=False, description="between positions, mm")
    frames_per_position: int | None = Field(default=None, ge=1, le=1000)
    poses: tuple[Literal["corner", "face"], ...] | None = Field(default=None, min_length=1)
    settle_s: float | None = Field(default=None, ge=0.0, le=60.0, description="wait after a move, s")
    exposure_s: float | None = Field(default=None, gt=0.0, le=60.0, description="exposure, s")
    gain_db: Finite | None = None

    def scan(self, configured: dict[str, Any]) -> ScanRecipe:
        """The scan, with what is not given here as ``configured``. Raises `ValueError` for one that can not be."""
        own = {name: getattr(self, name) for name in _Scan.model_fields if name not in Recipe.model_fields}
        given = {name: value for name, value in own.items() if value is not None}
        try:
            return ScanRecipe(**{**configured, **given, "kind": self.kind})
        except ValidationError as error:
            raise ValueError(_sentences(error)) from error


class ReferenceScan(_Scan):
    """Scan the cube with the standard pair, the biprism lowered (paper, section 2.2.1)."""

    kind: ClassVar[Literal["reference", "bsc"]] = "reference"

    recipe: Literal["reference-scan"] = "reference-scan"


class BscScan(_Scan):
    """Scan the cube through the biprism (paper, section 2.2.2), or ``between`` a scan's positions to validate one."""

    kind: ClassVar[Literal["reference", "bsc"]] = "bsc"

    recipe: Literal["bsc-scan"] = "bsc-scan"
    between: bool = Field(default=False, description="half-way between the positions, turned by 3 deg: for validation")


class Calibrate(Recipe):
    """Calibrate from the two scans' runs; with ``validation`` hold it against a run that took no part."""

    recipe: Literal["calibrate"] = "calibrate"
    reference: Name
    bsc: Name
    validation: Name | None = None


class SphereCheck(Recipe):
    """Record a sphere, measure it and fit it: how well the rig measures now (paper, section 2.2.3)."""

    recipe: Literal["sphere-check"] = "sphere-check"
    specimen: Specimen | None = "sphere"
    calibration: Name
    sphere: SphereRecipe = SphereRecipe()
    step_px: int = Field(default=10, ge=1, le=1000)


class Inflation(Recipe):
    """Record an inflation (paper, section 2.3); with ``calibration`` its frames are measured as they arrive."""

    recipe: Literal["inflation"] = "inflation"
    specimen: Specimen | None = "membrane"
    inflation: InflationRecipe = InflationRecipe()
    compression: Compression = "none"
    calibration: Name | None = Field(default=None, description="none: recorded, not measured live")
    step_px: int = Field(default=10, ge=1, le=1000, description="distance of the live points, px")


class Measure(Recipe):
    """Measure a recorded run with a calibration."""

    recipe: Literal["measure"] = "measure"
    calibration: Name
    run: Name
    step_px: int | None = Field(default=None, ge=1, le=1000, description="none: as configured")
    subset_px: int | None = Field(default=None, ge=5, le=201, description="none: as configured")
    stereo: Literal["biprism", "standard"] = "biprism"
    extrapolate: bool = False
    report: bool = Field(default=True, description="write a report beside the results")


SingleRecipe = Annotated[
    Home | Move | Align | ReferenceScan | BscScan | Calibrate | SphereCheck | Inflation | Measure,
    Field(discriminator="recipe"),
]


class CampaignStep(BaseModel):
    """A step: later ones name what it made by its ``name``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[Name, Field(max_length=60)]
    do: SingleRecipe


class Campaign(Recipe):
    """Recipes one after the other; a name of an earlier step stands for what it made."""

    recipe: Literal["campaign"] = "campaign"
    title: str = Field(default="campaign", min_length=1, max_length=100)
    steps: tuple[CampaignStep, ...] = Field(min_length=1, max_length=500)

    @model_validator(mode="after")
    def _each_named_once(self) -> Self:
        names = [step.name for step in self.steps]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"steps have the same name: {', '.join(twice)}; give each its own")
        return self


AnyRecipe = Annotated[
    Home | Move | Align | ReferenceScan | BscScan | Calibrate | SphereCheck | Inflation | Measure | Campaign,
    Field(discriminator="recipe"),
]

RECIPES: dict[str, type[Recipe]] = {
    kind.model_fields["recipe"].default: kind for kind in get_args(get_args(AnyRecipe)[0])
}
"""Every recipe by its name."""

DESK = ("calibrate", "measure")
"""Those that need no rig, and run beside one that does."""


def _sentences(error: ValidationError) -> str:
    """What is wrong, without pydantic's own words about it."""
    told = []
    for one in error.errors(include_url=False):
        place = ".".join(str(part) for part in one["loc"])
        told.append(f"{place}: {one['msg']}" if place else one["msg"].removeprefix("Value error, "))
    return "; ".join(told)
