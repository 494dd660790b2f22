"""How strain is measured, and what became of a point: settings, the window's size, statuses."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from bscd.analysis.surface.spacing import point_spacing, surface_scale
from bscd.arrays import FloatArray
from bscd.errors import InputError

_ORDERS = (1, 2, 3, 4)


class StrainStatus(IntEnum):
    """Why a point has a strain or none."""

    VALID = 0
    #: The point itself is not measured, in the reference or now.
    UNMEASURED = 1
    #: Fewer of its neighbours are measured than `StrainSettings.least_share` asks for, or they lie on few lines.
    FEW_NEIGHBOURS = 2
    #: Its neighbours lie to one side (the border): their centre is off by more than `StrainSettings.largest_offset`.
    ONE_SIDED = 3


@dataclass(frozen=True)
class StrainSettings:
    """How strain is measured.

    ``window_points`` is the strain window's edge in points, odd; None takes the largest whose virtual strain gauge is
    within ``vsg_mm``. ``subset_px`` is the DIC subset's edge, ``step_px`` the grid's step (None: from the points).
    Positions are fitted with polynomials of degree ``order`` along the surface and ``depth_order`` along its mean
    normal, where stereo noise is an order of magnitude larger: on the paper's membrane (15 % stretch, gauge of 5.6 mm,
    noise of 0.0006 and 0.008 mm) degree 2 alone errs by 2.8e-3, degree 3 alone by 2e-5 but adds 1.0e-3 of noise, and
    the two together err by 2.2e-4 and add 4.5e-4.
    ``correlated`` counts noise as shared between overlapping subsets.
    A window needs ``least_share`` of its window_points^2 neighbours, and their centre within ``largest_offset`` of its
    half width from the point (0.5 is a border).

    Raises `InputError` for values that make no window.
    """

    window_points: int | None = None
    vsg_mm: float = 6.0
    subset_px: float = 21.0
    step_px: float | None = None
    order: int = 3
    depth_order: int = 2
    correlated: bool = True
    least_share: float = 0.5
    largest_offset: float = 0.25

    def __post_init__(self) -> None:
        """Refuse what makes no window."""
        if self.order not in _ORDERS or self.depth_order not in _ORDERS:
            raise InputError(f"polynomial degrees of strain are 1 to 4, not {self.order} and {self.depth_order}")
        degree = max(self.order, self.depth_order)
        if self.window_points is not None and (self.window_points % 2 == 0 or self.window_points <= degree):
            raise InputError(
                f"a strain window is odd and larger than its degree {degree}, not {self.window_points} points"
            )
        if not (self.vsg_mm > 0.0 and self.subset_px > 0.0 and (self.step_px is None or self.step_px > 0.0)):
            raise InputError("vsg_mm, subset_px and step_px of a strain window must be positive")
        if not (0.0 < self.least_share <= 1.0 and 0.0 < self.largest_offset <= 0.5):
            raise InputError("least_share of a strain window lies in 0..1, largest_offset in 0..0.5")

    def window(self, points_px: FloatArray, reference_mm: FloatArray) -> StrainWindow:
        """The window for points ``(N, 2)`` px at ``(N, 3)`` mm.

        Raises
        ------
        InputError
            No window fits into ``vsg_mm``.
        """
        step_px = self.step_px or point_spacing(points_px)
        mm_per_px = surface_scale(points_px, reference_mm)
        window = self.window_points
        if window is None:
            intervals = (self.vsg_mm / mm_per_px - self.subset_px) / step_px
            window = 2 * int((intervals + 1e-9) // 2) + 1
            if window <= max(self.order, self.depth_order):
                raise InputError(
                    f"a virtual strain gauge of {self.vsg_mm:g} mm has no room for a strain window at step "
                    f"{step_px:g} px ({mm_per_px:.3g} mm/px, subset {self.subset_px:g} px); take a smaller step or a "
                    "larger vsg_mm"
                )
        return StrainWindow(window, step_px, self.subset_px, mm_per_px)


@dataclass(frozen=True)
class StrainWindow:
    """The strain window: its edge in points and the grid's step.

    The virtual strain gauge is (window_points - 1) step + subset: iDICs, "A Good Practices Guide for Digital Image
    Correlation" (2018).
    """

    window_points: int
    step_px: float
    subset_px: float
    mm_per_px: float

    @property
    def half_px(self) -> float:
        """Half the window's width, px."""
        return 0.5 * (self.window_points - 1) * self.step_px

    @property
    def vsg_px(self) -> float:
        """Size of the virtual strain gauge, px."""
        return 2.0 * self.half_px + self.subset_px

    @property
    def vsg_mm(self) -> float:
        """Size of the virtual strain gauge on the reference surface, mm."""
        return self.vsg_px * self.mm_per_px
