"""The figures show the data: sections, residuals, the share inside one sigma, the unfolded target."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from scipy.interpolate import griddata

from bscd.analysis.figures import RigDrawing, draw_error_map, draw_overview, draw_rig, draw_sigma_histogram
from bscd.analysis.figures.distortion_maps import cut_sections
from bscd.analysis.figures.error_volume import worst_dots
from bscd.analysis.figures.rig_drawing import overlap_outline_mm
from bscd.analysis.report.residuals import camera_residuals
from bscd.analysis.report.svg import inline_svg
from tests.analysis.exact_report import report_data

NOISE_PX = 0.01


@pytest.fixture(scope="module")
def data():
    return report_data(NOISE_PX)


def test_the_maps_sections_are_those_of_the_control_points(data):
    calibration = data.calibration
    sections = cut_sections(calibration)
    y, z, x = np.meshgrid(sections.y_mm, sections.z_mm, sections.x_mm, indexing="ij")
    at = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    shown = sections.shifts_px.reshape(-1, 4)
    some = np.flatnonzero(np.isfinite(shown[:, 0]))[::23]
    linear = griddata(calibration.control.distorted_mm, calibration.shifts_px, at[some])
    # the median: thin tetrahedra at the hull's border interpolate badly
    assert np.nanmedian(np.abs(shown[some] - linear)) < NOISE_PX
    assert len(some) > 500
    low, high = calibration.control.distorted_mm.min(axis=0), calibration.control.distorted_mm.max(axis=0)
    outside = np.any((at < low) | (at > high), axis=1)
    assert np.isnan(shown[outside]).all()
    assert np.isnan(shown).any(axis=1).sum() > 500  # corners of the box lie outside the hull


def test_the_full_models_leave_the_noise_and_the_pinhole_more(data):
    fields = camera_residuals(data.calibration, data.reference_views, data.target)
    assert list(fields) == ["biprism", "primary", "auxiliary"]
    for ideal, full in fields.values():
        assert full.rms_px == pytest.approx(NOISE_PX, rel=0.1)
        assert ideal.rms_px > 3 * NOISE_PX


def test_worst_dots_leave_out_what_was_not_reconstructed(data):
    volume = data.volume
    error = np.linalg.norm(volume.corrected_mm - volume.expected_mm, axis=1)
    known = np.flatnonzero(volume.inside)
    assert set(worst_dots(volume, 5)) == set(known[np.argsort(error[known])[-5:]])
    only = np.zeros_like(volume.inside)
    only[known[:3]] = True
    assert set(worst_dots(replace(volume, inside=only), 5)) == set(known[:3])


def test_the_error_map_colours_each_dot_inside_by_its_error(data):
    figure = draw_error_map(data.pos0, data.target)
    before = [c for c in figure.axes[0].collections if isinstance(c, PatchCollection)]
    pos0 = data.pos0
    expected = 1e3 * np.linalg.norm(pos0.uncorrected_mm - pos0.expected_mm, axis=1)[pos0.inside]
    assert np.allclose(np.sort(before[0].get_array()), np.sort(expected))
    assert len(before[1].get_paths()) == (~pos0.inside).sum()
    assert [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")] == [
        "Before correction",
        "After, same scale",
        "After, own scale",
    ]


def test_the_sigma_panels_state_the_share_inside_one_sigma(data):
    titles = [axes.get_title(loc="left") for axes in draw_sigma_histogram(data.volume).axes]
    volume = data.volume
    ratio = (volume.corrected_mm - volume.truth_mm)[volume.inside] / volume.sigma_mm[volume.inside]
    for title, values in zip(titles, ratio.T, strict=True):
        assert f"{100 * np.mean(np.abs(values) < 1):.0f} % within" in title


def test_the_overview_has_an_image_and_both_maps(data):
    figure = draw_overview(data.examples["Corner at POS.0 through the biprism"], data.pos0, data.target)
    assert len(figure.axes[0].images) == 1
    assert len(figure.axes) == 4


def test_inline_svg_keeps_to_itself(data):
    text = inline_svg(draw_sigma_histogram(data.volume), "sigma", "a title")
    assert text.startswith('<svg role="img" aria-label="a title" viewBox=')
    assert "http" not in text
    assert "xmlns" not in text
    assert "currentColor" in text


def test_what_both_views_see_is_where_their_spans_cross():
    # two views that are each 10 mm wide and approach each other by 1 mm a mm, from 20 mm apart
    rays = {
        "left": [np.array([[x, -30.0], [x + 40.0, 10.0]]) for x in (-20.0, -10.0)],
        "right": [np.array([[x, -30.0], [x - 40.0, 10.0]]) for x in (10.0, 20.0)],
    }
    rig = RigDrawing(np.array([0.0, -60.0]), np.array([[-20.0, -40.0], [20.0, -40.0], [0.0, -30.0]]), rays)
    outline = overlap_outline_mm(rig)
    # spans meet at y = -20, coincide at -15 and part at -10
    assert outline[:, 1].min() == pytest.approx(-20.0, abs=0.2)
    assert outline[:, 1].max() == pytest.approx(-10.0, abs=0.2)
    widest = outline[np.abs(outline[:, 1] + 15.0) < 0.1]
    assert np.ptp(widest[:, 0]) == pytest.approx(10.0, abs=0.2)
    assert len(draw_rig(rig).axes) == 2
