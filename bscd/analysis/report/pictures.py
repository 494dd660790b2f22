"""The figures of a report in their order, each with its title and a sentence that says what it shows."""

from __future__ import annotations

from collections.abc import Iterator

from bscd.analysis.figures import (
    draw_depth_thirds,
    draw_distortion_maps,
    draw_error_map,
    draw_error_volume,
    draw_residuals,
    draw_sigma_histogram,
)
from bscd.analysis.report.data import ReportData
from bscd.analysis.report.picture import Picture
from bscd.analysis.report.residuals import camera_residuals


def draw_pictures(data: ReportData) -> Iterator[Picture]:
    """Draw them one by one."""
    yield Picture(
        "error_map_pos0",
        "Error over the target at POS.0 (the paper's figure 4)",
        "Each square is a dot of the target, coloured by the distance d between where it was measured and where it "
        "is; these images took no part in the calibration. The first two panels share one colour scale. Hatched "
        "dots lie outside the calibrated hull and are not corrected; where both faces are seen, the dashed line is "
        "the cube's edge.",
        draw_error_map(data.pos0, data.target),
    )
    yield Picture(
        "distortion_maps",
        "The four maps (the paper's figure 6)",
        "By how many pixels the biprism and the lens displace an image point, depending on where the point lies in "
        "the volume. The sections go from near to far and end at the calibrated hull; lines join equal shifts. "
        "Smooth, nearly mirror-symmetric maps are what a well-aligned prism gives.",
        draw_distortion_maps(data.calibration),
    )
    yield Picture(
        "error_volume",
        "Before and after, dot by dot",
        "Left: every dot of the second acquisition at its depth, before and after. The lines are means; "
        f"{_floor_words(data)}Middle: the same errors counted. Right: the error after correction as the camera sees "
        "the volume, averaged over the depth; the rings are the worst dots of the table. A good correction leaves "
        "no pattern.",
        draw_error_volume(data.volume),
    )
    yield Picture(
        "error_depth_thirds",
        "Error in thirds of the depth",
        "The same errors in the near, middle and far third of the calibrated depth (numbers: means in micrometres). "
        "The three should agree; a far third that is worse says that the scan was too short.",
        draw_depth_thirds(data.volume),
    )
    fields = camera_residuals(data.calibration, data.reference_views, data.target)
    yield Picture(
        "residuals",
        "Residuals per camera",
        "Where dots were seen minus where the model puts them, averaged over squares of 48 px; each panel has its "
        "own scale bar. A pinhole alone cannot follow lens and prism: arrows with a pattern. With the full model "
        "only the noise of the dots' centres is left: short arrows in all directions. A pattern there means that "
        "something moved during the scan.",
        draw_residuals(fields, data.image_size_px),
    )
    yield Picture(
        "sigma_calibration",
        "Is the stated uncertainty right?",
        "The error of each corrected coordinate, divided by the one-sigma that the calibration states for it. If "
        "sigma is right the bars follow the line, the normal distribution, and 68 % lie between the dashed lines. "
        "Wider bars: sigma is too small; narrower: too large.",
        draw_sigma_histogram(data.volume),
    )


def _floor_words(data: ReportData) -> str:
    if not data.on_twin:
        return ""
    return "the floor is what the twin's exact rays make of the same images, so nothing can be better. "
