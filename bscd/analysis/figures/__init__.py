"""Figures of a calibration and of what it measured; each function gives a matplotlib figure of plain results."""

from bscd.analysis.figures.depth_thirds import draw_depth_thirds
from bscd.analysis.figures.distortion_maps import draw_distortion_maps
from bscd.analysis.figures.error_map import draw_error_map
from bscd.analysis.figures.error_volume import draw_error_volume
from bscd.analysis.figures.inflation_curves import InflationCurves, draw_inflation_curves
from bscd.analysis.figures.inflation_maps import MapRow, draw_map_rows, draw_own_scales
from bscd.analysis.figures.overview import draw_overview
from bscd.analysis.figures.residual_arrows import ResidualField, draw_residuals
from bscd.analysis.figures.rig_drawing import RigDrawing, draw_rig
from bscd.analysis.figures.sigma_histogram import draw_sigma_histogram
from bscd.analysis.figures.sphere_maps import Deviations, draw_sphere_beside, draw_sphere_maps
from bscd.analysis.figures.style import house_style

__all__ = [
    "Deviations",
    "InflationCurves",
    "MapRow",
    "ResidualField",
    "RigDrawing",
    "draw_depth_thirds",
    "draw_distortion_maps",
    "draw_error_map",
    "draw_error_volume",
    "draw_inflation_curves",
    "draw_map_rows",
    "draw_overview",
    "draw_own_scales",
    "draw_residuals",
    "draw_rig",
    "draw_sigma_histogram",
    "draw_sphere_beside",
    "draw_sphere_maps",
    "house_style",
]
