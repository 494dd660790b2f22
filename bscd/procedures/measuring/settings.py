"""What can be chosen for a measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, get_args

from bscd.acquisition.names import PHASES, PhaseName
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
        _require("step_px", self.step_px, _whole(self.step_px, 1), "a whole number of pixels from 1")
        odd = _whole(self.subset_px, 5) and self.subset_px % 2 == 1
        _require("subset_px", self.subset_px, odd, "an odd number of pixels from 5")
        for name, known in (
            ("stereo", get_args(StereoSource)),
            ("phase", (None, *PHASES)),
            ("stereo_shape", get_args(ShapeName)),
            ("tracking_shape", get_args(ShapeName)),
            ("lighting", get_args(Lighting)),
        ):
            value = getattr(self, name)
            _require(name, value, any(value == one for one in known), f"one of {', '.join(map(str, known))}")
        _require("zncc_min", self.zncc_min, _between(self.zncc_min, -1.0, 1.0), "a number between -1 and 1")
        limit = self.epipolar_limit_px
        _require(
            "epipolar_limit_px",
            limit,
            limit is None or limit == math.inf or _between(limit, 0.0, math.inf),
            "a distance above 0, or None for five times the calibration's limit for a frame,",
        )
        _require("vsg_mm", self.vsg_mm, _between(self.vsg_mm, 0.0, math.inf), "a size above 0")
        _require(
            "threads",
            self.threads,
            self.threads is None or _whole(self.threads, 1),
            "a whole number from 1, or None for all cores,",
        )

    def parameters(self) -> dict[str, str | bool | int | float]:
        """As a results file keeps them."""
        return {
            "step_px": int(self.step_px),
            "subset_px": int(self.subset_px),
            "stereo": self.stereo,
            "stereo_shape": self.stereo_shape,
            "zncc_min": float(self.zncc_min),
            "strain": self.strain,
            "vsg_limit_mm": float(self.vsg_mm),
            "extrapolate": self.extrapolate,
            "corrected": self.corrected,
            "region": "given" if self.region is not None else "texture",
            "interpolation": "quintic B-spline",
            "criterion": "ZNSSD",
            "optimisation": "IC-GN",
            "tracking_shape": self.tracking_shape,
            "lighting": self.lighting,
        }


def _require(name: str, value: Any, fits: bool, needed: str) -> None:
    if not fits:
        raise InputError(f"{name}: is {value}, {needed} is needed")


def _whole(value: Any, least: int) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= least


def _between(value: Any, low: float, high: float) -> bool:
    """Whether it is a number between two others, neither of them."""
    return isinstance(value, Real) and not isinstance(value, bool) and low < float(value) < high
