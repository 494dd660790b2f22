"""Figures of a calibration and of what it measured; each function gives a matplotlib figure of plain results."""

from bscd.analysis.figures.depth_thirds import draw_depth_thirds
from bscd.analysis.figures.distortion_maps import draw_distortion_maps
from bscd.analysis.figures.error_map import draw_error_map
from bscd.analysis.figures.error_volume import draw_error_volume
from bscd.analysis.figures.overview import draw_overview
from bscd.analysis.figures.residual_arrows import ResidualField, draw_residuals
from bscd.analysis.figures.rig_drawing import RigDrawing, draw_rig
from bscd.analysis.figures.sigma_histogram import draw_sigma_histogram
from bscd.analysis.figures.style import house_style

__all__ = [
    "ResidualField",
    "RigDrawing",
    "draw_depth_thirds",
    "draw_distortion_maps",
    "draw_error_map",
    "draw_error_volume",
    "draw_overview",
    "draw_residuals",
    "draw_rig",
    "draw_sigma_histogram",
    "house_style",
]
