"""What can be chosen for a measurement."""

from __future__ import annotations

from dataclasses import dataclass

from bscd.acquisition.names import PhaseName
from bscd.arrays import BoolArray
from bscd.dic.solver import Lighting, ShapeName
from bscd.errors import InputError
from bscd.results import StereoSource


@dataclass(frozen=True, eq=False)
class MeasureSettings:
    """How a run is measured.

    ``stereo`` names the pair of views; ``phase`` the frames (None: inflation where there are any, else sphere).
    ``region`` ``(H, W)`` is True where points are wanted in the left view (None: wherever there is texture).
    ``stereo_shape`` and ``tracking_shape`` "curved" follow curved surfaces and steep strains by the second derivatives
    that the field itself has, with the noise of "affine"; "quadratic" solves for them at every point, with twice the
    noise, for fields that change within a subset or two. ``lighting`` "linear" lets brightness change linearly across
    a subset, "uniform" by a gain and an offset only. ``epipolar_limit_px`` is the
    residual above which a point is refused (None: five times the calibration's limit for a frame). ``vsg_mm`` is the
    largest strain gauge; ``strain`` False leaves strains out. ``extrapolate`` keeps points outside the calibrated
    hull, marked as such. ``corrected`` False measures with the virtual cameras alone.
    """

    step_px: int = 10
    subset_px: int = 21
    stereo: StereoSource = "biprism"
    phase: PhaseName | None = None
    region: BoolArray | None = None
    stereo_shape: ShapeName = "curved"
    tracking_shape: ShapeName = "curved"
    lighting: Lighting = "linear"
    zncc_min: float = 0.7
    epipolar_limit_px: float | None = None
    strain: bool = True
    vsg_mm: float = 6.0
    extrapolate: bool = False
    corrected: bool = True
    threads: int | None = None

    def __post_init__(self) -> None:
        """Refuse what can not be measured with, in one sentence."""
        if self.step_px < 1:
            raise InputError(f"step_px: is {self.step_px}, at least 1 is needed")
        if self.subset_px < 5 or self.subset_px % 2 == 0:
            raise InputError(f"subset_px: is {self.subset_px}, an odd number of pixels from 5 is needed")
        if not 0.0 < self.vsg_mm < float("inf"):
            raise InputError(f"vsg_mm: is {self.vsg_mm}, a size above 0 is needed")

    def parameters(self) -> dict[str, str | bool | int | float]:
        """As a results file keeps them."""
        return {
            "step_px": self.step_px,
            "subset_px": self.subset_px,
            "stereo": self.stereo,
            "stereo_shape": self.stereo_shape,
            "zncc_min": self.zncc_min,
            "strain": self.strain,
            "vsg_limit_mm": self.vsg_mm,
            "extrapolate": self.extrapolate,
            "corrected": self.corrected,
            "region": "given" if self.region is not None else "texture",
            "interpolation": "quintic B-spline",
            "criterion": "ZNSSD",
            "optimisation": "IC-GN",
            "tracking_shape": self.tracking_shape,
            "lighting": self.lighting,
        }
