"""From a sequence's views to positions and displacements, frame by frame."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import ImageCovariances, Located
from bscd.dic import Status
from bscd.dic.solver import usable_cores
from bscd.dic.stereo import match_views
from bscd.dic.tracker_state import Tracked, TrackerState, at_rest
from bscd.dic.tracking import Tracker, TrackingSettings
from bscd.procedures.measuring.geometry import PairGeometry
from bscd.procedures.measuring.settings import MeasureSettings
from bscd.procedures.measuring.uncertainty import Uncertainty
from bscd.procedures.measuring.views import FrameViews


class PointStatus(IntEnum):
    """Whether a point was measured in a frame, or why not; the first are the correlation's own."""

    VALID = 0
    OUTSIDE = 1
    LOW_TEXTURE = 2
    NOT_CONVERGED = 3
    LOW_ZNCC = 4
    DIVERGED = 5
    NO_GUESS = 6
    NO_STEREO = 7
    """The reference's left and right view could not be matched there."""
    EPIPOLAR = 8
    """Left and right do not belong together, or the rig has moved."""
    OUTSIDE_VOLUME = 9
    """Outside the calibrated hull."""


@dataclass(frozen=True, eq=False)
class Measured:
    """One frame: a row a requested point, NaN where not known.

    ``xyz_mm``, ``displacement_mm``, ``sigma_mm`` and ``displacement_sigma_mm`` ``(N, 3)``, ``left_px``, ``right_px``
    ``(N, 2)``, ``zncc``, ``epipolar_px``, ``status`` ``(N,)``.
    """

    xyz_mm: FloatArray
    displacement_mm: FloatArray
    sigma_mm: FloatArray
    displacement_sigma_mm: FloatArray
    left_px: FloatArray
    right_px: FloatArray
    zncc: FloatArray
    epipolar_px: FloatArray
    status: NDArray[np.uint8]

    @property
    def valid(self) -> BoolArray:
        """Which points were measured, ``(N,)``."""
        return self.status == PointStatus.VALID


class Sequence:
    """Matches the reference's two views once, then tracks each view and triangulates."""

    def __init__(
        self,
        reference: FrameViews,
        points_px: FloatArray,
        geometry: PairGeometry,
        settings: MeasureSettings,
        noise_grey: tuple[float, float],
        epipolar_limit_px: float,
    ) -> None:
        self.points_px = points_px
        self._geometry = geometry
        self._limit_px = epipolar_limit_px
        self._extrapolate = settings.extrapolate
        self._threads = settings.threads or usable_cores()
        self.stereo = match_views(
            reference.left,
            reference.right,
            points_px,
            geometry.curve,
            subset_px=settings.subset_px,
            shape=settings.stereo_shape,
            lighting=settings.lighting,
            noise_grey=noise_grey[0],
            zncc_min=settings.zncc_min,
            threads=settings.threads,
        )
        self._right_px = points_px + self.stereo.displacement_px
        self.tracking = TrackingSettings(
            subset_px=settings.subset_px,
            shape=settings.tracking_shape,
            lighting=settings.lighting,
            zncc_min=settings.zncc_min,
            noise_grey=noise_grey,
            threads=(self._threads + 1) // 2,
        )
        self._usable = self.stereo.valid
        self._left = Tracker(reference.left, points_px[self._usable], self.tracking)
        self._right = Tracker(reference.right, self._right_px[self._usable], self.tracking)
        self._stereo = self.stereo.only(self._usable)
        self._located = geometry.locate(points_px[self._usable], self._right_px[self._usable])
        self._uncertainty = Uncertainty(
            self._stereo, points_px[self._usable], self._right_px[self._usable], settings.subset_px
        )
        here, there = at_rest(points_px[self._usable]), at_rest(self._right_px[self._usable])
        self.reference = self._measured(
            here, replace(there, zncc=self._stereo.zncc), self._located, self._uncertainty.of_reference()
        )

    def measure(self, frame: FrameViews) -> Measured:
        """The next frame."""
        return self.combine(*self._tracked(frame))

    def starts(self) -> tuple[TrackerState, TrackerState]:
        """Left and right tracker, from which others may track the frames and hand them to `combine`."""
        return self._left.state(), self._right.state()

    @property
    def stray(self) -> BoolArray:
        """What `combine` keeps from frame to frame, ``(n,)``; to go on from an earlier frame set it back."""
        return self._uncertainty.stray

    @stray.setter
    def stray(self, which: BoolArray) -> None:
        self._uncertainty.stray = which

    def combine(self, left: Tracked, right: Tracked) -> Measured:
        """The next frame, of which both views were tracked."""
        located = self._geometry.locate(left.position_px, right.position_px)
        return self._measured(left, right, located, self._uncertainty.of_frame(left, right))

    def _tracked(self, frame: FrameViews) -> tuple[Tracked, Tracked]:
        """Both views, at the same time where there are cores for it."""
        if self._threads == 1:
            return self._left.track(frame.left), self._right.track(frame.right)
        with ThreadPoolExecutor(1, thread_name_prefix="right view") as beside:
            right = beside.submit(self._right.track, frame.right)
            return self._left.track(frame.left), right.result()

    def _measured(self, left: Tracked, right: Tracked, located: Located, images: ImageCovariances) -> Measured:
        usable = self._usable
        points = self._geometry.describe(located, images.position_px2)
        status = np.where(left.status != Status.VALID, left.status, right.status).astype(np.uint8)
        found = status == PointStatus.VALID
        outside = found & ~(points.inside & self._located.inside)
        status[outside] = PointStatus.OUTSIDE_VOLUME
        status[found & (points.epipolar_px > self._limit_px)] = PointStatus.EPIPOLAR
        kept = (PointStatus.VALID, PointStatus.OUTSIDE_VOLUME) if self._extrapolate else (PointStatus.VALID,)
        shown = np.isin(status, kept)
        displacement = points.xyz_mm - self._located.points.xyz_mm
        sigma = self._geometry.displacement_sigma_mm(located, self._located, images)
        whole = np.full(len(self.points_px), PointStatus.NO_STEREO, np.uint8)
        whole[usable] = status
        whole[self.stereo.status == Status.OUTSIDE] = PointStatus.OUTSIDE

        def spread(values: FloatArray, where: BoolArray) -> FloatArray:
            out = np.full((len(self.points_px), *values.shape[1:]), np.nan)
            out[usable] = np.where(where.reshape(-1, *(1,) * (values.ndim - 1)), values, np.nan)
            return out

        return Measured(
            xyz_mm=spread(points.xyz_mm, shown),
            displacement_mm=spread(displacement, shown),
            sigma_mm=spread(points.sigma_mm, shown),
            displacement_sigma_mm=spread(sigma, shown),
            left_px=spread(left.position_px, found),
            right_px=spread(right.position_px, found),
            zncc=spread(np.minimum(left.zncc, right.zncc), found),
            epipolar_px=spread(points.epipolar_px, found),
            status=whole,
        )
