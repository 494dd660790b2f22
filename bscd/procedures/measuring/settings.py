"""What can be chosen for a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bscd.acquisition import PhaseName
from bscd.arrays import BoolArray
from bscd.dic.solver import ShapeName
from bscd.errors import InputError
from bscd.results import StereoSource

StereoShape = Literal["auto", "affine", "quadratic"]


@dataclass(frozen=True, eq=False)
class MeasureSettings:
    """How a run is measured.

    ``stereo`` names the pair of views; ``phase`` the frames (None: inflation where there are any, else sphere).
    ``region`` ``(H, W)`` is True where points are wanted in the left view (None: wherever there is texture).
    ``stereo_shape`` "auto" takes second order where the surface's curvature asks for it; ``tracking_shape`` "quadratic"
    follows steep strains without bias, with twice the noise and a third more time. ``epipolar_limit_px`` is the
    residual above which a point is refused (None: five times the calibration's limit for a frame). ``vsg_mm`` is the
    largest strain gauge; ``strain`` False leaves strains out. ``extrapolate`` keeps points outside the calibrated
    hull, marked as such. ``corrected`` False measures with the virtual cameras alone.
    """

    step_px: int = 10
    subset_px: int = 21
    stereo: StereoSource = "biprism"
    phase: PhaseName | None = None
    region: BoolArray | None = None
    stereo_shape: StereoShape = "auto"
    tracking_shape: ShapeName = "affine"
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
        }
