"""Measured surfaces: the sphere fit, the membrane's frame, strain, and noise floors; pure functions of arrays."""

from bscd.analysis.surface.frame import MembraneFrame
from bscd.analysis.surface.noise_floor import NoiseFloor, noise_floor
from bscd.analysis.surface.sphere import SphereFit, fit_sphere, radial_deviation
from bscd.analysis.surface.strain import surface_strain
from bscd.analysis.surface.strain_gauge import StrainGauge, SurfaceStrain
from bscd.analysis.surface.strain_settings import StrainSettings, StrainStatus, StrainWindow

__all__ = [
    "MembraneFrame",
    "NoiseFloor",
    "SphereFit",
    "StrainGauge",
    "StrainSettings",
    "StrainStatus",
    "StrainWindow",
    "SurfaceStrain",
    "fit_sphere",
    "noise_floor",
    "radial_deviation",
    "surface_strain",
]
