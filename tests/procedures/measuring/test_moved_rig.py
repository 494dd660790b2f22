"""A rig that moves during a run is told of, by the epipolar residuals of the frames after it."""

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from bscd.acquisition import CameraName, FrameRecord, RunFile
from bscd.procedures.live import LiveMeasurement, LiveSetup, LiveWarning
from bscd.procedures.measuring import MeasureSettings, PointStatus, measure_run, measure_to_file
from bscd.results import Origin, ResultsFile
from tests.procedures.measuring.twin_runs import LOWERED_MM, REST_KPA, TwinRuns, write

COARSE = MeasureSettings(step_px=20, strain=False, phase="inflation")
PAIR = MeasureSettings(step_px=20, strain=False, phase="sphere", stereo="standard")
PRESSURES_KPA = (REST_KPA, 1.6, 3.2)


def lower(image, by_px):
    """What an image shows, lower by so much."""
    return np.clip(np.rint(ndimage.shift(image.astype(float), (by_px, 0.0), order=5, mode="nearest")), 0, 255)


def moved(image, by_px):
    """An image through the biprism whose right view is lower."""
    out = image.copy()
    out[:, 640:] = lower(image, by_px)[:, 640:].astype(np.uint8)
    return out


@pytest.fixture(scope="module")
def images(twin_runs: TwinRuns):
    return [twin_runs.image(twin_runs.inflated(p)) for p in PRESSURES_KPA]


@pytest.fixture
def measured(wide, twin_runs, tmp_path):
    """Measure images through the biprism: (frames, what was warned of)."""

    def measure(images, settings=COARSE):
        records = [twin_runs.frame(image, k, p) for k, (image, p) in enumerate(zip(images, PRESSURES_KPA, strict=True))]
        said: list[str] = []
        with RunFile(write(tmp_path / "run.h5", records)) as run:
            return list(measure_run(wide, run, settings, warn=said.append).frames), said

    return measure


def test_a_good_sequence_is_not_warned_of(measured, images):
    frames, said = measured(images)
    assert min(frame.valid.mean() for frame in frames) > 0.8
    assert said == []


def test_a_little_is_told_once_from_where_it_begins(measured, images):
    frames, said = measured([images[0], moved(images[1], 0.3), moved(images[2], 0.3)])
    (text,) = said
    # 0.3 px between the views is 0.3 / sqrt(2) across the epipolar lines of both
    assert text.startswith(
        "from frame 1 on the median epipolar residual is 0.21 px (limit 0.1): camera or biprism have moved since the "
        "calibration; calibrate again"
    )
    assert frames[1].valid.mean() > 0.8


def test_much_is_told_with_how_many_points_it_costs(measured, images):
    frames, (moving, refused) = measured([images[0], moved(images[1], 3.0), moved(images[2], 3.0)])
    assert moving.startswith("from frame 1 on the median epipolar residual is 2.1")
    matched = np.isfinite(frames[1].epipolar_px)
    count = np.count_nonzero(frames[1].status == PointStatus.EPIPOLAR)
    assert count > 0.9 * matched.sum() > 400
    assert refused == (
        f"from frame 1 on {count} of {matched.sum()} points that match are refused (status epipolar), more than 0.5 px "
        f"beside their epipolar lines"
    )


def test_one_that_had_moved_before_is_told_of_its_reference_alone(measured, images):
    _, said = measured([moved(image, 0.3) for image in images])
    (text,) = said
    assert text.startswith("in the reference the median epipolar residual is 0.21 px (limit 0.1)")


def test_a_frame_that_shows_nothing_says_nothing_of_the_rig(measured, images):
    noise = np.random.default_rng(3).normal(60.0, 2.0, images[0].shape)
    frames, said = measured([images[0], np.clip(np.rint(noise), 0, 255).astype(np.uint8), images[2]])
    assert not frames[1].valid.any()
    assert said == []


def test_results_keep_the_median_of_each_frame(wide, twin_runs, images, tmp_path):
    seen = [images[0], moved(images[1], 0.3), np.full_like(images[0], 20)]
    records = [twin_runs.frame(image, k, p) for k, (image, p) in enumerate(zip(seen, PRESSURES_KPA, strict=True))]
    with RunFile(write(tmp_path / "run.h5", records)) as run:
        measure_to_file(wide, run, tmp_path / "results.h5", COARSE)
    with ResultsFile(tmp_path / "results.h5") as results:
        medians = results.array("epipolar_median_px")
        assert results.header.parameters["epipolar_limit_px"] == 5.0 * wide.epipolar_limit_px
    assert medians[0] < 0.02
    assert medians[1] == pytest.approx(0.3 / np.sqrt(2.0), abs=0.02)
    assert np.isnan(medians[2])


@pytest.fixture
def pair(wide, twin_runs, tmp_path):
    """Measure the sphere by the pair, the auxiliary camera's images lower by so much: what was warned of."""
    low = twin_runs.sphere_state._replace(jack_mm=LOWERED_MM)
    shown: dict[CameraName, np.ndarray] = {camera: twin_runs.image(low, camera) for camera in ("primary", "auxiliary")}

    def measure(*lower_px):
        records = [
            FrameRecord(
                camera,
                "sphere",
                image if camera == "primary" else lower(image, by_px).astype(np.uint8),
                frame_id=k,
                jack_mm=LOWERED_MM,
            )
            for k, by_px in enumerate(lower_px)
            for camera, image in shown.items()
        ]
        said: list[str] = []
        with RunFile(write(tmp_path / "pair.h5", records, ("primary", "auxiliary"))) as run:
            frames = list(measure_run(wide, run, PAIR, warn=said.append).frames)
        assert frames[0].valid.sum() > 400
        return said

    return measure


def test_a_good_pair_is_not_warned_of(pair):
    assert pair(0.0, 0.0) == []


@pytest.mark.parametrize(("by_px", "median", "told"), [(0.3, "0.21", 1), (3.0, "2.1", 2)])
def test_a_camera_of_the_pair_that_moves(pair, by_px, median, told):
    said = pair(0.0, by_px, by_px)
    assert len(said) == told
    assert said[0].startswith(f"from frame 1 on the median epipolar residual is {median}")
    assert "(limit 0.1): primary or auxiliary camera have moved since the calibration" in said[0]


def test_it_is_told_live(wide, images, tmp_path):
    events = []
    setup = LiveSetup(
        calibration=wide,
        size_px=(1280, 1024),
        out=tmp_path / "live.h5",
        title="inflation",
        run=Origin("run.h5", "", ""),
        settings=COARSE,
        workers=1,
        nice=0,
    )
    with LiveMeasurement(setup, events.append) as live:
        for number, image in enumerate([images[0], images[2], moved(images[2], 0.3), moved(images[2], 0.3)]):
            assert live.push(number, image, number / 11, REST_KPA + number)
        begun_s = time.monotonic()
        while not any(isinstance(event, LiveWarning) for event in events):
            assert time.monotonic() - begun_s < 120.0
            time.sleep(0.01)
        live.finish(None, 120.0)
    (text,) = [event.text for event in events if isinstance(event, LiveWarning)]
    assert text.startswith("from frame 2 on the median epipolar residual is 0.21 px (limit 0.1)")


def test_the_virtual_cameras_alone_have_no_limit_to_be_held_against(measured, images):
    """Their epipolar lines are off by what the correction takes out."""
    frames, said = measured([images[0], moved(images[1], 0.3), images[2]], replace(COARSE, corrected=False))
    assert min(frame.valid.mean() for frame in frames) > 0.5
    assert said == []
