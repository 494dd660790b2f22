"""Everything that the digital twin can be told, validated; the defaults are the paper's rig (DESIGN section 3)."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Vector2 = tuple[Finite, Finite]
Vector3 = tuple[Finite, Finite, Finite]

SceneName = Literal["empty", "cube", "sphere", "membrane"]


class _Options(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class CameraGeometry(_Options):
    """Lens, sensor and place of one camera."""

    focal_length_mm: Positive = Field(default=75.0, description="pinhole distance, mm")
    pixel_size_mm: Positive = Field(default=0.0067, description="edge of a square pixel, mm")
    width_px: int = Field(default=1280, ge=16, le=16384, description="columns of the sensor, px")
    height_px: int = Field(default=1024, ge=16, le=16384, description="rows of the sensor, px")
    principal_offset_px: Vector2 = Field(
        default=(0.0, 0.0), description="principal point from the sensor's middle, px (columns, rows)"
    )
    distortion: tuple[Finite, Finite, Finite, Finite] = Field(
        default=(-0.5, 0.0, 0.0, 0.0),
        description="Brown's k1, k2, p1, p2, measured to ideal point, over the focal length",
    )
    position_mm: Vector3 = Field(default=(0.0, -622.0, 0.0), description="centre of projection in the world, mm")
    looks_at_mm: Vector3 = Field(default=(0.0, 0.0, 0.0), description="a world point on the optical axis, mm")
    roll_deg: Finite = Field(default=0.0, description="turn about the optical axis, deg")


class AuxiliaryGeometry(CameraGeometry):
    """The same, standing as far from the target as the primary camera, 20 degrees to its right."""

    position_mm: Vector3 = Field(
        default=(622.0 * math.sin(math.radians(20.0)), -622.0 * math.cos(math.radians(20.0)), 0.0),
        description="centre of projection in the world, mm",
    )


class PrismOptions(_Options):
    """The biprism and how it stands."""

    refractive_index: float = Field(default=1.4585, gt=1.0, lt=3.0, description="index at the light's wavelength")
    alpha_deg: float = Field(default=161.4, gt=90.0, lt=180.0, description="apex angle of the roof, deg")
    thickness_mm: Positive = Field(default=30.0, description="back face to roof edge, mm")
    width_mm: Positive = Field(default=60.0, description="across the roof edge, mm")
    height_mm: Positive = Field(default=50.0, description="along the roof edge, mm")
    edge_mm: Vector3 = Field(default=(0.0, -210.0, 0.0), description="middle of the roof edge when raised, world, mm")
    tilt_deg: Vector3 = Field(
        default=(0.3, -0.4, 0.2), description="misalignment: turns about world x, then y, then z, deg"
    )
    raised_mm: Finite = Field(default=70.0, description="jack height at which the edge is at edge_mm, mm")
    lowered_mm: Finite = Field(default=5.0, description="jack height at which the prism is out of view, mm")

    @model_validator(mode="after")
    def _roof_thinner_than_prism(self) -> PrismOptions:
        drop = self.width_mm / 2.0 * math.tan(math.radians(180.0 - self.alpha_deg) / 2.0)
        if drop >= self.thickness_mm:
            raise ValueError(
                f"thickness_mm = {self.thickness_mm:g} must exceed the roof's drop of {drop:.1f} mm at the flanks; "
                "make the prism thicker, narrower or its apex angle larger"
            )
        return self


class CubeOptions(_Options):
    """The dotted cube: the same square grid on two adjacent faces."""

    columns: int = Field(default=9, ge=1, le=200, description="dot columns of a face")
    rows: int = Field(default=23, ge=1, le=200, description="dot rows of a face")
    pitch_mm: Positive = Field(default=2.0, description="distance of neighbouring dots, mm")
    dot_diameter_mm: Positive = Field(default=1.0, description="diameter of a dot, mm")
    margin_mm: Positive = Field(
        default=2.0, description="cube's edge to the first column's centres, and round the grid, mm"
    )
    paper: Fraction = Field(default=1.0, description="reflectance of the face, 0..1")
    ink: Fraction = Field(default=0.08, description="reflectance of a dot, 0..1")
    bare: Fraction = Field(default=0.35, description="reflectance of the other faces, 0..1")

    @model_validator(mode="after")
    def _dots_apart(self) -> CubeOptions:
        if self.dot_diameter_mm >= self.pitch_mm or self.dot_diameter_mm / 2.0 >= self.margin_mm:
            raise ValueError(
                f"dot_diameter_mm = {self.dot_diameter_mm:g} must be below pitch_mm and half of it below margin_mm"
            )
        return self


class StageOptions(_Options):
    """Where the stages' axes really point, and their readings at the named positions."""

    rotation_axis_mm: Vector2 = Field(default=(0.6, 13.5), description="rotation axis at world z = 0: x, y, mm")
    rotation_tilt_deg: Vector2 = Field(default=(0.15, -0.1), description="its tilt off z towards x and y, deg")
    translation_tilt_deg: Vector2 = Field(default=(0.2, -0.15), description="travel off y towards x and z, deg")
    corner_deg: Finite = Field(default=45.0, description="rotation reading in the corner pose, deg")
    origin_mm: Finite = Field(default=50.0, description="translation reading at POS.0, mm")


class SpeckleOptions(_Options):
    """A speckle pattern: a uniform cubic B-spline with random coefficients, fixed to the material."""

    spacing_mm: Positive = Field(default=0.13, description="coefficient spacing, mm; a speckle is about 1.9 of it wide")
    dark: Fraction = Field(default=0.05, description="reflectance of the darkest paint, 0..1")
    bright: Fraction = Field(default=0.95, description="reflectance of the brightest ground, 0..1")
    seed: int = Field(default=1, ge=0, description="seed of the pattern")
    samples: Literal[2, 3] = Field(default=2, description="Gauss-Legendre points per pixel axis")


class SphereOptions(_Options):
    """The speckled sphere."""

    radius_mm: Positive = Field(default=18.265, description="radius, mm")
    centre_mm: Vector3 = Field(default=(0.6, 13.0, 0.5), description="centre when placed, world, mm")
    speckle: SpeckleOptions = SpeckleOptions(seed=11)


class MembraneOptions(_Options):
    """The speckled circular membrane, clamped over a window and inflated."""

    radius_mm: Positive = Field(default=15.0, description="radius of the clamped window, mm")
    thickness_mm: Positive = Field(default=0.16, description="undeformed thickness, mm")
    calibration_kpa: Positive = Field(
        default=13.0, description="pressure at which the pole rises by calibration_rise_mm, kPa"
    )
    calibration_rise_mm: Positive = Field(default=6.0, description="rise of the pole at calibration_kpa, mm")
    centre_mm: Vector3 = Field(default=(0.6, 8.0, 0.0), description="middle of the window when placed, world, mm")
    tilt_deg: Vector3 = Field(default=(0.6, 0.3, -0.8), description="turns about world x, y, z off facing -y, deg")
    ring_width_mm: Positive = Field(default=4.0, description="visible width of the clamping ring, mm")
    ring: Fraction = Field(default=0.25, description="reflectance of the ring, 0..1")
    speckle: SpeckleOptions = SpeckleOptions(seed=12)

    @model_validator(mode="after")
    def _shallow(self) -> MembraneOptions:
        if self.calibration_rise_mm > 0.8 * self.radius_mm:
            raise ValueError(
                "calibration_rise_mm must be at most 0.8 of radius_mm: the cap must stay below a half sphere"
            )
        return self


class LightOptions(_Options):
    """Two lamps and a diffuse part; a surface that faces the camera has brightness ``level``."""

    level: Fraction = Field(
        default=0.70, description="white paper facing the camera, of full scale at nominal exposure"
    )
    ambient: Fraction = Field(default=0.40, description="diffuse share of the light, 0..1")
    lamp_azimuth_deg: Vector2 = Field(default=(-45.0, 45.0), description="lamps' directions off -y towards +x, deg")
    lamp_elevation_deg: Finite = Field(default=15.0, description="lamps' height above the horizontal, deg")
    gradient_per_mm: Vector3 = Field(
        default=(0.002, 0.0, 0.001), description="relative change of light along x, y, z, 1/mm"
    )
    background: Fraction = Field(default=0.10, description="brightness where no object is, of full scale")
    vignetting: Fraction = Field(default=0.05, description="loss of light in the sensor's corners, 0..1")


class SensorOptions(_Options):
    """From irradiance to grey levels."""

    bits: int = Field(default=8, ge=8, le=16, description="bits of a pixel")
    nominal_exposure_s: Positive = Field(default=0.02, description="exposure at which irradiance 1 is full scale, s")
    blur_px: float = Field(default=0.7, ge=0.0, le=10.0, description="sigma of the lens's Gaussian point spread, px")
    noise_grey: float = Field(
        default=2.0, ge=0.0, le=64.0, description="total noise at brightness `working_level`, of 255"
    )
    noise: Literal["shot", "gaussian"] = Field(
        default="shot", description="shot + read noise, or Gaussian noise_grey everywhere"
    )
    read_noise_grey: float = Field(default=0.5, ge=0.0, description="read noise of the shot model, of 255")
    working_level: float = Field(default=0.7, gt=0.0, le=1.0, description="brightness at which noise_grey holds")

    @model_validator(mode="after")
    def _read_below_total(self) -> SensorOptions:
        if self.noise == "shot" and 0.0 < self.noise_grey <= self.read_noise_grey:
            raise ValueError("noise_grey is the total and must exceed read_noise_grey (or be 0 for no noise at all)")
        return self


class RestOptions(_Options):
    """What the stages, the jacks and the pressure read while no device is bound to them."""

    rotation_deg: Finite = Field(default=45.0, description="rotation stage, deg")
    translation_mm: Finite = Field(default=50.0, description="translation stage, mm")
    jack_mm: Finite = Field(default=70.0, description="height of the lab jacks, mm")
    pressure_kpa: float = Field(default=0.05, ge=0.0, description="gauge pressure behind the membrane, kPa")


class StoreOptions(_Options):
    """How the world's state is quantised and how many rendered frames are kept."""

    memory_mb: int = Field(default=600, ge=16, description="bound on the kept frames, MB")
    rotation_step_deg: Positive = Field(default=0.0005, description="quantum of the state, deg")
    translation_step_mm: Positive = Field(default=0.0001, description="quantum of the state, mm")
    jack_step_mm: Positive = Field(default=0.001, description="quantum of the state, mm")
    pressure_step_kpa: Positive = Field(default=0.005, description="quantum of the state, kPa")


class TwinOptions(_Options):
    """The digital twin of the rig; world frame and conventions as in DESIGN section 2."""

    primary: CameraGeometry = Field(default=CameraGeometry(), description="the camera behind the biprism")
    auxiliary: AuxiliaryGeometry = Field(
        default=AuxiliaryGeometry(), description="the second camera of the reference stereo pair"
    )
    prism: PrismOptions = Field(default=PrismOptions(), description="the biprism")
    stages: StageOptions = Field(default=StageOptions(), description="true axes of the stages")
    cube: CubeOptions = Field(default=CubeOptions(), description="the calibration target")
    sphere: SphereOptions = Field(default=SphereOptions(), description="the speckled sphere")
    membrane: MembraneOptions = Field(default=MembraneOptions(), description="the inflated membrane")
    light: LightOptions = Field(default=LightOptions(), description="the illumination")
    sensor: SensorOptions = Field(default=SensorOptions(), description="both cameras' sensors")
    rest: RestOptions = Field(default=RestOptions(), description="readings without devices")
    store: StoreOptions = Field(default=StoreOptions(), description="the frame store")
    scene: SceneName = Field(default="cube", description="the object on the stage at the start")
