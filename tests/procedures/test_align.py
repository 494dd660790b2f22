import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from bscd.errors import CheckFailedError, InputError
from bscd.procedures import AlignmentItem, AlignmentReport, align_biprism, align_cameras
from bscd.procedures.dot_figures import edge_sigma_px
from drivers.twin.options import TwinOptions
from tests.procedures.twin_rig import TARGET, TwinRig


def changed(section: str, **changes: object) -> TwinOptions:
    options = TwinOptions()
    return options.model_copy(update={section: getattr(options, section).model_copy(update=changes)})


def biprism(**changes: object) -> AlignmentReport:
    return align_biprism(TwinRig(options=changed("prism", **changes)).rig, TARGET, frames=2)


def cameras(options: TwinOptions) -> AlignmentReport:
    return align_cameras(TwinRig(options=options).rig, TARGET, frames=2)


class TestBiprism:
    def test_the_papers_rig_is_aligned(self, twin: TwinRig) -> None:
        report = align_biprism(twin.rig, TARGET, frames=2)
        assert report.ok, [item for item in report.items if not item.ok]
        assert not any(item.advice for item in report.items)

    def test_roll_is_the_angle_that_the_prism_was_turned(self) -> None:
        # about world y, away from the camera: clockwise as the camera sees it
        item = biprism(tilt_deg=(0.0, 2.0, 0.0))["biprism roll"]
        assert item.value == pytest.approx(2.0, rel=0.06)
        assert not item.ok
        assert "counter-clockwise about the viewing axis" in item.advice

    def test_nod_shows_as_opposite_lean_of_the_columns(self) -> None:
        # about world x: the top goes away from the camera; and the other sign of the roll
        report = biprism(tilt_deg=(-3.0, -2.0, 0.0))
        assert "towards the camera" in report["column lean, right minus left"].advice
        assert report["biprism roll"].value == pytest.approx(-2.0, rel=0.06)
        assert "deg clockwise about the viewing axis" in report["biprism roll"].advice

    def test_target_off_centre(self, twin: TwinRig) -> None:
        twin.world.place("cube", shift_mm=(2.0, 0.0, 0.0))
        item = align_biprism(twin.rig, TARGET, frames=2)["middle of the two grids from the image's middle"]
        # 2 mm at 622 mm from a 75 mm lens on 0.0134 mm pixels, the glass brings it a little nearer
        assert item.value == pytest.approx(2.0 * 75.0 / 622.0 / 0.0134, rel=0.05)
        assert "to the left" in item.advice

    def test_the_split_line_is_seen_when_it_cuts_the_target(self) -> None:
        twin = TwinRig(options=changed("prism", tilt_deg=(0.0, 1.5, 0.0), edge_mm=(2.0, -210.0, 0.0)))
        twin.world.place("cube", shift_mm=(8.0, 0.0, 0.0))
        report = align_biprism(twin.rig, TARGET, frames=1)
        place = report["split line from the image's middle"]
        # the edge is 412 mm from the lens, of which 30 mm of glass look like 30 / 1.4585
        assert place.value == pytest.approx(2.0 * 75.0 / (412.0 - 30.0 + 30.0 / 1.4585) / 0.0134, abs=1.5)
        assert place.note == ""
        assert place.advice.startswith("shift the biprism to the left")
        assert report["split line tilt"].value == pytest.approx(1.5, abs=0.1)

    def test_target_cut_by_the_split_line(self, twin: TwinRig) -> None:
        twin.world.place("cube", shift_mm=(8.0, 0.0, 0.0))
        item = align_biprism(twin.rig, TARGET, frames=1)["dots, right minus left"]
        assert item.value > 0
        assert "to the left" in item.advice

    def test_prism_out_of_view(self) -> None:
        with pytest.raises(CheckFailedError, match="biprism is not in the view"):
            align_biprism(TwinRig(raised_mm=5.0).rig, TARGET, frames=1)

    def test_raises_the_biprism_first(self, twin: TwinRig) -> None:
        twin.rig.jacks.move_to(5.0)
        align_biprism(twin.rig, TARGET, frames=1)
        assert twin.rig.jacks.status().position == 70.0


class TestCameras:
    def test_the_papers_rig_is_aligned(self, twin: TwinRig) -> None:
        report = align_cameras(twin.rig, TARGET, frames=2)
        assert report.ok, [item for item in report.items if not item.ok]
        assert twin.rig.jacks.status().position == 5.0

    def test_height_is_what_the_camera_was_lifted_by(self) -> None:
        x_mm, y_mm, _ = TwinOptions().auxiliary.position_mm
        report = cameras(changed("auxiliary", position_mm=(x_mm, y_mm, 3.0), looks_at_mm=(0.0, 0.0, 3.0)))
        item = report["target's height in the images, auxiliary below primary"]
        assert item.value == pytest.approx(3.0, rel=0.03)
        assert item.advice.startswith("lower the auxiliary camera")

    def test_roll_is_what_the_camera_was_turned_by(self) -> None:
        item = cameras(changed("auxiliary", roll_deg=2.0))["roll, auxiliary against primary"]
        assert abs(item.value) == pytest.approx(2.0, rel=0.03)
        assert not item.ok

    def test_scale_is_that_of_the_lenses(self) -> None:
        item = cameras(changed("auxiliary", focal_length_mm=85.0))["scale, auxiliary over primary"]
        assert item.value == pytest.approx(85.0 / 75.0, rel=0.01)
        assert "away" in item.advice

    def test_blur_is_seen(self) -> None:
        twin = TwinRig(options=changed("sensor", blur_px=3.0))
        twin.rig.rotation.move_to(0.0)
        report = align_cameras(twin.rig, TARGET, pose="face", frames=2)
        for camera in ("primary", "auxiliary"):
            item = report[f"{camera}: blur of the dots' edges"]
            assert not item.ok
            assert item.advice.startswith("focus")

    def test_settings_that_differ(self, twin: TwinRig) -> None:
        assert twin.rig.auxiliary is not None
        twin.rig.auxiliary.configure(exposure_s=0.016, gain_db=1.0)
        report = align_cameras(twin.rig, TARGET, frames=1)
        assert report["exposure, auxiliary over primary"].value == pytest.approx(0.8)
        assert report["exposure, auxiliary over primary"].advice == (
            "set the auxiliary camera's exposure to 0.02 s, as the primary's"
        )
        assert report["gain, auxiliary minus primary"].advice.endswith("gain to 0 dB, as the primary's")

    def test_too_dim(self, twin: TwinRig) -> None:
        for camera in twin.rig.cameras.values():
            camera.configure(exposure_s=0.008)
        item = align_cameras(twin.rig, TARGET, frames=1)["primary: brightness between the dots"]
        assert "lengthen the exposure" in item.advice

    def test_without_an_auxiliary_camera(self, twin: TwinRig) -> None:
        with pytest.raises(InputError, match="no auxiliary camera"):
            align_cameras(replace(twin.rig, auxiliary=None), TARGET)


def test_a_figure_that_is_not_known_is_not_good() -> None:
    assert not AlignmentItem("split", math.nan, "px", 1.0).ok


@pytest.mark.parametrize("blur_px", [0.7, 1.5, 2.5])
def test_edge_blur_of_a_drawn_dot(blur_px: float) -> None:
    fine = 8
    rows, columns = np.mgrid[0 : 33 * fine, 0 : 33 * fine] / fine - 16.5
    dot = np.where(np.hypot(rows, columns) < 9.0, 30.0, 180.0)
    blurred = gaussian_filter(dot, blur_px * fine)
    patch = blurred.reshape(33, fine, 33, fine).mean(axis=(1, 3))
    # the pixels' own area blurs by 1 / sqrt(12)
    assert edge_sigma_px(patch) == pytest.approx(np.hypot(blur_px, 1.0 / np.sqrt(12.0)), rel=0.15)
