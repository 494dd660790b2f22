"""Frames that go wrong: what is called valid is true, what is lost has its reason, and the rest goes on."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import Calibration, CalibrationChoices, calibrate
from bscd.errors import InputError
from bscd.procedures.measuring import MeasureSettings, PointStatus, measure_run
from bscd.procedures.measuring.glare import glare
from bscd.results import FrameResult
from drivers.twin.placement import RigState
from tests.calibration.exact_rig import ExactRig, paper_prism
from tests.procedures.measuring.twin_runs import CAMERA, RAISED_MM, REST_KPA, TwinRuns, write

COARSE = MeasureSettings(step_px=20, strain=False)
PRESSURES_KPA = (REST_KPA, 1.6, 3.2, 5.0)

#: Farther from the truth than this is no measurement: half a pixel between the views is 0.27 mm of depth.
GROSS_MM = 0.25

#: Middle and half widths of glare that hides about a third of the membrane, px: in the left view, the right, or both.
GLARE = {"left": (400, 420, 60, 130), "right": (1010, 640, 60, 130), "both": (640, 330, 700, 55)}


@dataclass(frozen=True, eq=False)
class Followed:
    """A run's frames beside the truth of each requested point."""

    frames: list[FrameResult]
    truth_mm: list[FloatArray | None]
    speckled: BoolArray

    def valid(self, k: int) -> int:
        return int(np.count_nonzero(self.frames[k].valid))

    def hold(self) -> None:
        """Every valid point is where it truly is, and every other one has its reason and no position."""
        for frame, truth in zip(self.frames, self.truth_mm, strict=True):
            lost = ~frame.valid
            assert set(frame.status[lost].tolist()) <= {int(code) for code in PointStatus if code}
            assert np.isnan(frame.xyz_mm[lost]).all()
            assert np.isnan(frame.displacement_mm[lost]).all()
            if truth is None:
                assert lost.all()
                continue
            known = frame.valid & self.speckled
            if not known.any():
                continue
            error = np.linalg.norm((frame.xyz_mm - truth)[known], axis=1)
            assert error.max() < GROSS_MM
            assert np.median(error) < 0.02
            moved = truth - self.truth_mm[0]
            assert np.linalg.norm((frame.displacement_mm - moved)[known], axis=1).max() < GROSS_MM


@pytest.fixture(scope="module")
def states(twin_runs: TwinRuns) -> list[RigState]:
    return [twin_runs.inflated(p) for p in PRESSURES_KPA]


@pytest.fixture(scope="module")
def images(twin_runs: TwinRuns, states):
    return [twin_runs.image(state) for state in states]


@pytest.fixture
def follow(wide: Calibration, twin_runs: TwinRuns, states, tmp_path):
    """Measure images; the truth of each is that of the state with this number, or of a state, or None."""

    def measure(images, shown, calibration=wide) -> Followed:
        records = [twin_runs.frame(image, k, REST_KPA + k) for k, image in enumerate(images)]
        with RunFile(write(tmp_path / "run.h5", records)) as run:
            measurement = measure_run(calibration, run, COARSE)
            frames = list(measurement.frames)
        real = [states[s] if isinstance(s, int) else s for s in shown]
        material, speckled = twin_runs.material(measurement.sequence.points_px, real[0])
        truth = [None if state is None else twin_runs.world.surface_positions(material, state) for state in real]
        return Followed(frames, truth, speckled)

    return measure


def glaring(image, column, row, wide_px, high_px, level=700.0):
    """A lamp's reflection with a soft edge, clipped as the sensor clips it."""
    y, x = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    light = level * np.exp(-(((x - column) / wide_px) ** 2) / 2 - ((y - row) / high_px) ** 2 / 2)
    return np.clip(np.rint(image + light), 0, 255).astype(np.uint8)


def gone(number, level=50):
    noise = np.random.default_rng(number).normal(0.0, 2.0, (CAMERA.height_px, CAMERA.width_px))
    return np.clip(np.rint(level + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("where", GLARE)
class TestGlare:
    def test_in_some_frames(self, follow, images, where):
        bright = [glaring(image, *GLARE[where]) for image in images[1:3]]
        found = follow([images[0], *bright, images[3]], [0, 1, 2, 3])
        found.hold()
        for k in (1, 2):
            assert 0.3 < found.valid(k) / found.valid(0) < 0.8
        assert found.valid(3) > 0.95 * found.valid(0)

    def test_in_the_reference(self, follow, images, where):
        found = follow([glaring(images[0], *GLARE[where]), images[1], images[2]], [0, 1, 2])
        found.hold()
        assert found.valid(0) > 100
        assert found.valid(2) > 0.9 * found.valid(0)


def test_haze_that_clips_nothing(follow, images):
    hazy = np.clip(0.5 * images[1] + glaring(np.zeros_like(images[1]), 400, 500, 160, 260, 110.0), 0, 255)
    found = follow([images[0], hazy.astype(np.uint8), images[2]], [0, 1, 2])
    found.hold()
    assert found.valid(1) > 0.9 * found.valid(0)


class TestGone:
    def test_a_membrane_that_bursts_and_a_new_one_at_rest(self, follow, images):
        found = follow([*images[:3], *(gone(k) for k in range(3)), images[0], images[1]], [0, 1, 2, *[None] * 3, 0, 1])
        found.hold()
        assert min(found.valid(6), found.valid(7)) > 0.97 * found.valid(0)

    def test_back_in_another_place(self, follow, images, states, twin_runs):
        rest = states[0]
        there = rest._replace(placement=rest.placement._replace(shift_mm=(1.5, 0.5, 2.0)))  # 30 px
        found = follow([images[0], images[1], gone(1), gone(2), twin_runs.image(there)], [0, 1, None, None, there])
        found.hold()
        assert found.valid(4) > 0.85 * found.valid(0)  # some have left the volume

    @pytest.mark.parametrize("level", [0, 255])
    def test_a_frame_all_black_or_white(self, follow, images, level):
        found = follow([images[0], np.full_like(images[0], level), images[1]], [0, None, 1])
        found.hold()
        assert found.valid(2) > 0.97 * found.valid(0)


def test_frames_out_of_focus(follow, images):
    """A shock: ever more blurred, then sharp again. What blur leaves is true; sharp frames are as good as ever."""
    blurred = [cv2.GaussianBlur(images[1], (0, 0), sigma) for sigma in (2.0, 4.0, 8.0)]
    found = follow([images[0], *blurred, images[2], images[3]], [0, 1, 1, 1, 2, 3])
    found.hold()
    assert found.valid(1) > 0.9 * found.valid(0)
    assert min(found.valid(4), found.valid(5)) > 0.95 * found.valid(0)


def test_frames_out_of_order_and_dropped(follow, images):
    order = [0, 3, 1, 0, 2]
    found = follow([images[k] for k in order], order)
    found.hold()
    assert min(found.valid(k) for k in range(5)) > 0.95 * found.valid(0)


class TestCalibrationOfAnotherRig:
    @staticmethod
    def other(by_deg: float) -> Calibration:
        """Of a rig whose prism is turned by so much about the cameras' depth."""
        rig = ExactRig(noise_px=0.01, prism=paper_prism(tilt_deg=(0.3, -0.4 + by_deg, 0.2)))
        steps = {"poses": ("face", "corner"), "positions": range(-8, 9, 2)}
        size = (CAMERA.width_px, CAMERA.height_px)
        reference, bsc = rig.reference(**steps), rig.bsc(**steps)
        return calibrate(reference, bsc, rig.target, size, CalibrationChoices(), jack_mm=RAISED_MM)

    def test_is_refused_for_its_epipolar_residual(self, follow, images):
        with pytest.raises(InputError, match=r"px \(median\) beside their epipolar lines, limit 0\.5"):
            follow(images[:2], [0, 1], self.other(0.2))

    def test_that_differs_a_little_is_told_of_and_true_where_it_is_valid(self, follow, images, twin_runs, tmp_path):
        calibration = self.other(0.065)
        follow(images[:2], [0, 1], calibration).hold()
        said: list[str] = []
        with RunFile(write(tmp_path / "again.h5", [twin_runs.frame(images[0], 0)])) as run:
            reference = measure_run(calibration, run, COARSE, warn=said.append).sequence.reference
        assert any("have moved since the calibration" in text for text in said)
        beside = reference.status == PointStatus.EPIPOLAR
        assert beside.any()
        assert (reference.epipolar_px[beside] > 0.5).all()
        assert (reference.epipolar_px[reference.valid] <= 0.5).all()


class TestWhatIsGlare:
    def test_saturated_speckles_are_none(self, images):
        assert glare(images[0].astype(np.float32), 21) is None
        bright = np.clip(images[0].astype(np.float32) * 2.5, 0, 255)
        assert (bright == 255).mean() > 0.02
        found = glare(bright, 21)
        assert found is None or found.mean() < 0.1

    def test_it_reaches_as_far_as_speckles_are_clipped(self, images):
        image = glaring(images[0], *GLARE["left"]).astype(np.float32)
        found = glare(image, 21)
        assert found is not None
        around = cv2.dilate((image == 255).view(np.uint8), np.ones((3, 3), np.uint8)).view(bool)
        assert found[around].mean() > 0.99
        assert found.sum() < 2.0 * (image == 255).sum()
