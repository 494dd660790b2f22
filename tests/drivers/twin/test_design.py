"""The design figures against hand formulae and against the twin itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.twin.design import design_rig

PAPER = {
    "refractive_index": 1.4585,
    "alpha_deg": 161.4,
    "thickness_mm": 30.0,
    "focal_length_mm": 75.0,
    "pixel_size_mm": 0.0067,
    "width_px": 1280,
    "height_px": 1024,
    "object_distance_mm": 210.0,
    "camera_distance_mm": 382.0,
}


def test_thin_and_paraxial_limit():
    rig = PAPER | {"alpha_deg": 179.0, "thickness_mm": 0.4, "camera_distance_mm": 400.0}
    design = design_rig(**rig)
    deviation = 0.4585 * math.radians(0.5)
    away = 400.0 + 210.0
    half_field = 640 * 0.0067 / 75.0
    stereo = 2.0 * deviation * 400.0 / away
    assert design.stereo_angle_deg == pytest.approx(math.degrees(stereo), rel=2e-3)
    assert design.half_view_width_mm == pytest.approx(away * half_field, rel=2e-3)
    assert design.overlap_width_mm == pytest.approx(2.0 * deviation * 210.0, rel=5e-3)
    assert design.depth_per_px_mm == pytest.approx(0.0067 / 75.0 * away / stereo, rel=3e-3)
    assert design.magnification_px_per_mm == pytest.approx(75.0 / 0.0067 / away, rel=2e-3)
    assert design.prism_height_mm == pytest.approx(2 * 512 * 0.0067 / 75.0 * 400.0, rel=3e-3)
    assert design.prism_width_mm == pytest.approx(2 * half_field * 400.0, rel=3e-3)
    assert design.prism_travel_mm == pytest.approx(design.prism_height_mm, rel=3e-3)


def test_rays_obey_snell_at_both_faces_of_the_papers_prism():
    design = design_rig(**PAPER)
    beta = math.radians(9.3)
    for line in design.rays_xy_mm:
        before, within, after = (np.diff(line, axis=0)[i] for i in range(3))
        side = np.sign(line[1, 0])
        assert math.sin(math.atan2(*before)) == pytest.approx(1.4585 * math.sin(math.atan2(*within)), abs=1e-12)
        turned = [math.atan2(*part) - side * beta for part in (within, after)]
        assert 1.4585 * math.sin(turned[0]) == pytest.approx(math.sin(turned[1]), abs=1e-12)
        assert line[3, 1] == pytest.approx(0.0, abs=1e-12)


def test_the_papers_prism_is_large_enough_and_its_jacks_clear_the_view():
    design = design_rig(**PAPER)
    assert design.prism_width_mm < 60.0
    assert design.prism_height_mm < 50.0
    assert design.prism_travel_mm < 84.0
    assert 5.0 < design.stereo_angle_deg < 6.5
    assert design.overlap_width_mm > 30.0  # the membrane's window


def test_a_narrow_sensor_sees_nothing_with_both_halves():
    assert design_rig(**(PAPER | {"width_px": 200})).overlap_width_mm == 0.0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"alpha_deg": 200.0}, "alpha_deg"),
        ({"thickness_mm": 1.0}, "too thin"),
        ({"object_distance_mm": -1.0}, "object_distance_mm"),
        ({"alpha_deg": 91.0, "thickness_mm": 80.0}, "reflected"),
    ],
)
def test_impossible_rigs_are_refused(change, says):
    with pytest.raises(ValueError, match=says):
        design_rig(**(PAPER | change))
