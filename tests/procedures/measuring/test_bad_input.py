"""What can not be measured is refused in one sentence, or flagged with its reason while the rest goes on."""

from dataclasses import replace

import numpy as np
import pytest

from bscd.acquisition import CameraMeta, FrameRecord, RunFile, RunWriter
from bscd.errors import InputError
from bscd.procedures.measuring import MeasureSettings, PointStatus, measure_run, measure_to_file
from bscd.results import ResultsFile
from bscd.results.export import export_csv
from drivers.interfaces import FrameStatus
from tests.procedures.measuring.twin_runs import CAMERA, LOWERED_MM, REST_KPA, TwinRuns, narrowed, write

COARSE = MeasureSettings(step_px=25)
NAN = float("nan")


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


class TestBadFrames:
    """Frames that did not come whole."""

    def test_the_others_keep_their_numbers(self, wide, twin_runs, images, tmp_path):
        records = [twin_runs.frame(image, k, REST_KPA + k) for k, image in enumerate([*images, images[1]])]
        records[1] = replace(records[1], status=FrameStatus.INCOMPLETE)
        said: list[str] = []
        with RunFile(write(tmp_path / "run.h5", records)) as run:
            settings = replace(COARSE, strain=False)
            header = measure_to_file(wide, run, tmp_path / "results.h5", settings, warn=said.append)
        with ResultsFile(tmp_path / "results.h5") as results:
            assert results.frame_numbers().tolist() == [0, 2, 3]
            np.testing.assert_allclose(results.array("time_s"), np.array([0, 2, 3]) / 11)
            made = export_csv(results, tmp_path / "tables")
        assert header.reference_frames == (0,)
        assert [path.name for path in made] == ["frame_0000.csv", "frame_0002.csv", "frame_0003.csv"]
        assert said == [
            f"{tmp_path / 'run.h5'}: 1 of 4 inflation frames are left out: 1 incomplete in the primary camera (frame 1)"
        ]

    def test_one_at_rest_is_no_part_of_the_reference(self, wide, twin_runs, images, tmp_path):
        rest = [twin_runs.frame(images[0], k, REST_KPA) for k in range(4)]
        rest[1] = replace(rest[1], status=FrameStatus.INCOMPLETE)
        records = [*rest, twin_runs.frame(images[1], 4, 1.65)]
        with RunFile(write(tmp_path / "run.h5", records)) as run:
            measurement = measure_run(wide, run, COARSE)
            assert [frame.number for frame in measurement.frames] == [0, 2, 3, 4]
        assert measurement.header.reference_frames == (0, 2, 3)

    def test_of_different_cameras_of_the_pair(self, wide, twin_runs, tmp_path):
        """No frame is measured with another's partner: all that is valid is where it truly is."""
        states = [twin_runs.inflated(p)._replace(jack_mm=LOWERED_MM) for p in (REST_KPA, 1.0, 2.0, 4.0, 6.0)]
        lost = {("primary", 1), ("auxiliary", 3)}
        records = [
            FrameRecord(
                camera,
                "inflation",
                twin_runs.image(state, camera),
                frame_id=k,
                jack_mm=LOWERED_MM,
                time_s=k / 11,
                pressure_kpa=state.pressure_kpa,
                status=FrameStatus.INCOMPLETE if (camera, k) in lost else FrameStatus.OK,
            )
            for k, state in enumerate(states)
            for camera in ("primary", "auxiliary")
        ]
        with RunFile(write(tmp_path / "pair.h5", records, ("primary", "auxiliary"))) as run:
            measurement = measure_run(wide, run, MeasureSettings(step_px=30, stereo="standard", strain=False))
            frames = list(measurement.frames)
        assert [frame.number for frame in frames] == [0, 2, 4]
        material, speckled = twin_runs.material(measurement.sequence.points_px, states[0])
        for frame in frames:
            truth = twin_runs.world.surface_positions(material, states[frame.number])
            error = np.linalg.norm(frame.xyz_mm - truth, axis=1)[frame.valid & speckled]
            assert len(error) > 100
            assert np.median(error) < 0.02


class TestRefused:
    def test_a_reference_without_speckle(self, measured, images):
        with pytest.raises(InputError, match="no speckled surface in the left view"):
            measured([blank(), images[0]])

    def test_views_with_nothing_in_common(self, measured, images):
        halves = images[0].copy()
        halves[:, 640:] = images[0][::-1, 640:]
        with pytest.raises(InputError, match="match nowhere inside the calibrated volume"):
            measured([halves])

    @pytest.mark.parametrize(
        ("width_px", "height_px", "made"),
        [
            (640, 512, lambda image: image[::2, ::2]),
            (1280, 960, lambda image: image[32:-32]),
            (1312, 1056, lambda image: np.pad(image, 16)),
        ],
        ids=["binned", "cropped", "larger"],
    )
    def test_a_calibration_of_another_image_size(self, wide, twin_runs, images, tmp_path, width_px, height_px, made):
        frames = [twin_runs.frame(np.ascontiguousarray(made(images[0])), 0, REST_KPA)]
        path = write(tmp_path / "other.h5", frames, camera=CameraMeta(width_px, height_px, 8))
        said = (
            f"calibration: it is for 1280 x 1024 px of the primary camera, the run's images are {width_px} x "
            f"{height_px} px; set region \\(ROI\\) and binning as when calibrated, or calibrate again$"
        )
        with RunFile(path) as run, pytest.raises(InputError, match=said):
            measure_run(wide, run, COARSE)

    @pytest.mark.parametrize("camera", ["primary", "auxiliary"])
    @pytest.mark.parametrize(("width_px", "height_px"), [(1280, 960), (1312, 1056)])
    def test_a_calibration_of_another_image_size_of_the_pair(self, wide, tmp_path, camera, width_px, height_px):
        cameras = {"primary": CAMERA, "auxiliary": CAMERA, camera: CameraMeta(width_px, height_px, 8)}
        path = tmp_path / "pair.h5"
        with RunWriter(path, title="pair", cameras=cameras) as run:
            for name, meta in cameras.items():
                grey = np.full((meta.height_px, meta.width_px), 90, np.uint8)
                run.append(FrameRecord(name, "sphere", grey, frame_id=0, jack_mm=LOWERED_MM))
        said = f"for 1280 x 1024 px of the {camera} camera, the run's images are {width_px} x {height_px} px"
        with RunFile(path) as run, pytest.raises(InputError, match=said):
            measure_run(wide, run, replace(COARSE, stereo="standard"))

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
        ("name", "values", "needed"),
        [
            ("step_px", (0, -1, 2.5, 10.0, True, "10", None), "a whole number of pixels from 1 is needed"),
            ("subset_px", (20, 3, 21.5, 21.0, -21, "21"), "an odd number of pixels from 5 is needed"),
            ("stereo", ("foo", "", None), "one of biprism, standard is needed"),
            (
                "phase",
                ("nope",),
                "one of None, reference-corner, reference-face, bsc-corner, bsc-face, sphere, inflation is needed",
            ),
            ("stereo_shape", ("cubic", None), "one of translation, affine, curved, quadratic is needed"),
            ("tracking_shape", ("cubic", 2), "one of translation, affine, curved, quadratic is needed"),
            ("lighting", ("x", None), "one of uniform, linear is needed"),
            ("zncc_min", (5.0, 1.0, NAN, None), "a number between -1 and 1 is needed"),
            (
                "epipolar_limit_px",
                (-1.0, 0.0, 0, NAN, -np.inf, "1"),
                "a distance above 0, or None for five times the calibration's limit for a frame, is needed",
            ),
            ("vsg_mm", (0.0, -6.0, NAN, np.inf, None), "a size above 0 is needed"),
            ("threads", (0, -2, 1.5, True), "a whole number from 1, or None for all cores, is needed"),
        ],
    )
    def test_settings(self, name, values, needed):
        for value in values:
            with pytest.raises(InputError) as error:
                MeasureSettings(**{name: value})
            assert str(error.value) == f"{name}: is {value}, {needed}"

    def test_settings_that_are_numbers_of_numpy_are_as_good(self):
        given = {
            "step_px": np.int64(7),
            "subset_px": np.int32(19),
            "vsg_mm": np.float32(5.0),
            "zncc_min": np.float32(0.5),
        }
        kept = MeasureSettings(**given, epipolar_limit_px=np.inf).parameters()
        assert {type(value) for value in kept.values()} <= {str, bool, int, float}  # all that a results file takes
        assert (kept["step_px"], kept["subset_px"], kept["vsg_limit_mm"], kept["zncc_min"]) == (7, 19, 5.0, 0.5)


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
