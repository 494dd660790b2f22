"""What can not be measured is refused in one sentence, or flagged with its reason while the rest goes on."""

from dataclasses import replace

import numpy as np
import pytest

from bscd.acquisition import CameraMeta, RunFile, RunWriter
from bscd.errors import InputError
from bscd.procedures.measuring import MeasureSettings, PointStatus, measure_run, measure_to_file
from bscd.results import ResultsFile
from tests.procedures.measuring.twin_runs import CAMERA, REST_KPA, TwinRuns, narrowed, write

COARSE = MeasureSettings(step_px=25)


@pytest.fixture(scope="module")
def images(twin_runs: TwinRuns):
    return [record.data for record in twin_runs.inflation((REST_KPA, REST_KPA + 1.6, REST_KPA + 3.2))]


@pytest.fixture
def measured(wide, twin_runs: TwinRuns, tmp_path):
    """Measure a sequence of images; (measurement, its frames)."""

    def measure(images, settings=COARSE, calibration=wide, warn=None):
        records = [twin_runs.frame(image, k, REST_KPA + k) for k, image in enumerate(images)]
        with RunFile(write(tmp_path / "run.h5", records)) as run:
            measurement = measure_run(calibration, run, settings, warn=warn)
            return measurement, list(measurement.frames)

    return measure


def blank(level=120, seed=1):
    noise = np.random.default_rng(seed).normal(0.0, 2.0, (CAMERA.height_px, CAMERA.width_px))
    return np.clip(np.rint(level + noise), 0, 255).astype(np.uint8)


class TestFlagged:
    def test_a_frame_without_speckle_and_the_next_good_one(self, measured, images):
        _, frames = measured([images[0], blank(), images[1]])
        assert frames[0].valid.any()
        assert not frames[1].valid.any()
        assert np.isnan(frames[1].uvw_mm).all()
        assert set(np.unique(frames[1].status)) <= {int(code) for code in PointStatus if code}
        assert frames[2].valid.sum() > 0.97 * frames[0].valid.sum()

    def test_a_membrane_that_bursts(self, measured, images):
        _, frames = measured([*images[:2], blank(40, 2), blank(60, 3)])
        assert [bool(frame.valid.any()) for frame in frames] == [True, True, False, False]
        assert [frame.number for frame in frames] == list(range(4))

    def test_glare_over_a_third(self, measured, images):
        glaring = images[1].copy()
        glaring[:, 300:620] = 255
        _, frames = measured([images[0], glaring, images[1]])
        at = frames[0].left_px[:, 0]
        assert not frames[1].valid[at > 330].any()
        assert frames[1].valid[frames[0].valid & (at < 250)].mean() > 0.95
        assert frames[2].valid.sum() > 0.97 * frames[0].valid.sum()

    def test_glare_in_the_reference(self, measured, images):
        glaring = images[0].copy()
        glaring[:400] = 255
        _, frames = measured([glaring, images[1]])
        assert frames[1].valid.sum() > 50
        assert not frames[1].valid[frames[1].status == PointStatus.NO_STEREO].any()

    def test_points_outside_the_volume(self, measured, images, wide, twin_runs):
        rest = twin_runs.inflated(REST_KPA)
        moved = rest._replace(placement=rest.placement._replace(shift_mm=(2.5, 0.0, 0.0)))
        _, frames = measured([images[0], twin_runs.image(moved)], calibration=narrowed(wide))
        for frame in frames:
            outside = frame.status == PointStatus.OUTSIDE_VOLUME
            assert outside.any()
            assert np.isnan(frame.xyz_mm[outside]).all()
            assert np.isfinite(frame.displacement_mm[frame.valid]).all()
        left = frames[0].valid & ~frames[1].valid
        assert left.any()  # and what has come in has no reference to be displaced from
        assert not (frames[1].valid & ~frames[0].valid).any()

    def test_points_outside_the_volume_when_asked_for(self, measured, images, wide):
        _, frames = measured(images[:2], replace(COARSE, extrapolate=True), calibration=narrowed(wide))
        for frame in frames:
            outside = frame.status == PointStatus.OUTSIDE_VOLUME
            assert outside.any()
            assert (frame.extrapolated == outside).all()
            assert np.isfinite(frame.displacement_mm[outside]).all()
            assert np.nanmedian(frame.sigma_mm[outside]) > np.nanmedian(frame.sigma_mm[frame.valid])
            assert np.isnan(frame.strain[outside]).all()

    def test_a_wrong_match_is_not_extrapolated(self, measured, images, wide):
        settings = replace(COARSE, extrapolate=True, strain=False, epipolar_limit_px=1e-4)
        _, frames = measured(images[:1], settings, calibration=narrowed(wide))
        assert (frames[0].status == PointStatus.EPIPOLAR).sum() > 100
        assert np.nanmax(frames[0].epipolar_px[frames[0].valid | frames[0].extrapolated], initial=0.0) <= 1e-4

    def test_a_rig_that_moved(self, measured, images):
        said: list[str] = []
        moved = images[0].copy()
        moved[3:, 640:] = images[0][:-3, 640:]  # the right view three rows lower
        _, frames = measured([moved, moved], replace(COARSE, epipolar_limit_px=50.0), warn=said.append)
        assert frames[0].valid.any()
        assert np.nanmedian(frames[0].epipolar_px) > 1.5
        assert any("have moved since the calibration" in text for text in said)


class TestRefused:
    def test_a_reference_without_speckle(self, measured, images):
        with pytest.raises(InputError, match="no speckled surface in the left view"):
            measured([blank(), images[0]])

    def test_views_with_nothing_in_common(self, measured, images):
        halves = images[0].copy()
        halves[:, 640:] = images[0][::-1, 640:]
        with pytest.raises(InputError, match="match nowhere inside the calibrated volume"):
            measured([halves])

    def test_a_calibration_of_another_image_size(self, wide, twin_runs, images, tmp_path):
        small = [twin_runs.frame(np.ascontiguousarray(images[0][::2, ::2]), 0, REST_KPA)]
        path = write(tmp_path / "small.h5", small, camera=CameraMeta(640, 512, 8))
        with RunFile(path) as run, pytest.raises(InputError, match="the run's images are 640 x 512 px"):
            measure_run(wide, run, COARSE)

    def test_a_calibration_that_is_not_of_a_biprism(self, measured, images, wide):
        control = wide.control
        swapped = replace(wide, control=replace(control, left_px=control.right_px, right_px=control.left_px))
        with pytest.raises(InputError, match="not of a biprism"):
            measured(images[:1], calibration=swapped)

    def test_a_region_of_another_size(self, measured, images):
        with pytest.raises(InputError, match="its shape is"):
            measured(images[:1], replace(COARSE, region=np.ones((5, 5), bool)))

    def test_a_region_without_anything(self, measured, images):
        with pytest.raises(InputError, match="region"):
            measured(images[:1], replace(COARSE, region=np.zeros((1024, 1280), bool)))

    def test_no_standard_pair(self, wide, twin_runs, sphere_run):
        with RunFile(sphere_run) as run, pytest.raises(InputError, match="no standard stereo pair"):
            measure_run(replace(wide, lenses={}), run, replace(COARSE, stereo="standard"))

    @pytest.mark.parametrize(
        ("settings", "said"),
        [({"step_px": 0}, "step_px"), ({"subset_px": 20}, "odd"), ({"vsg_mm": 0.0}, "vsg_mm")],
    )
    def test_settings(self, settings, said):
        with pytest.raises(InputError, match=said):
            MeasureSettings(**settings)


class TestCutOff:
    def test_a_run_that_was_interrupted(self, wide, twin_runs, images, tmp_path):
        path = tmp_path / "run.h5"
        with (
            pytest.raises(RuntimeError, match="lamp"),
            RunWriter(path, title="run", cameras={"primary": CAMERA}) as run,
        ):
            for k, image in enumerate(images):
                run.append(twin_runs.frame(image, k, REST_KPA + k))
            raise RuntimeError("the lamp went out")
        with RunFile(path) as run:
            frames = list(measure_run(wide, run, COARSE).frames)
        assert [frame.number for frame in frames] == [0, 1, 2]
        assert all(frame.valid.any() for frame in frames)

    def test_a_measurement_that_is_interrupted_keeps_its_frames(self, wide, twin_runs, images, tmp_path):
        records = [twin_runs.frame(image, k, REST_KPA + k) for k, image in enumerate(images)]

        def stop(progress):
            if progress.done == 2:
                raise KeyboardInterrupt

        with RunFile(write(tmp_path / "run.h5", records)) as run, pytest.raises(KeyboardInterrupt):
            measure_to_file(wide, run, tmp_path / "result.h5", COARSE, progress=stop)
        with ResultsFile(tmp_path / "result.h5") as results:
            assert not results.complete
            assert list(results.frame_numbers()) == [0, 1]
            assert results.verify() is None
