"""Measured surfaces: the sphere fit, the membrane's frame, strain, and noise floors; pure functions of arrays."""

from bscd.analysis.surface.frame import MembraneFrame
from bscd.analysis.surface.sphere import SphereFit, fit_sphere, radial_deviation

__all__ = ["MembraneFrame", "SphereFit", "fit_sphere", "radial_deviation"]
