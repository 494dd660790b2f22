import hashlib
import struct
from dataclasses import replace

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bscd.acquisition import AxisMeta, CameraMeta, FrameRecord, RunFile, RunState, RunWriter
from bscd.errors import InputError
from drivers.interfaces import FrameStatus, PressureReading, Range
from tests.acquisition.run_records import AXES, CAMERAS, PRESSURE, SETTINGS, frames, same


def write(path, records, **changes):
    with RunWriter(path, **(SETTINGS | changes)) as run:
        for record in records:
            run.append(record)
    return path


def test_every_frame_comes_back_bit_for_bit_in_order(tmp_path):
    recorded = [*frames(12), FrameRecord("primary", "sphere", np.full((8, 12), 255, np.uint8), 7)]
    with RunFile(write(tmp_path / "run.h5", recorded)) as run:
        read = list(run.frames())
        assert len(read) == len(recorded)
        assert all(same(a, b) for a, b in zip(recorded, read, strict=True))
        assert run.complete
        assert run.state is RunState.COMPLETE
        assert run.verify() is None


def test_header_comes_back(tmp_path):
    path = write(tmp_path / "run.h5", frames(2), pressure=PRESSURE, run_uuid="0f", program_version="9.9")
    with RunFile(path) as run:
        assert run.title == SETTINGS["title"]
        assert run.config_text == SETTINGS["config_text"]
        assert run.recipe_text == SETTINGS["recipe_text"]
        assert (run.uuid, run.header.program_version) == ("0f", "9.9")
        assert run.header.start_time == "2026-03-01T12:00:00.000+00:00"
        assert run.end_time == "2026-03-01T12:00:00.000+00:00"
        assert run.cameras["primary"] == CAMERAS["primary"]
        assert replace(run.cameras["auxiliary"], pixel_size_mm=0.0) == replace(CAMERAS["auxiliary"], pixel_size_mm=0.0)
        assert np.isnan(run.cameras["auxiliary"].pixel_size_mm)
        assert run.header.axes["translation"] == AXES["translation"]
        assert run.header.axes["jack"].limits == Range(0.0, 84.0)
        assert run.header.pressure == PRESSURE


def test_camera_and_phase_select(tmp_path):
    recorded = list(frames(8))
    recorded[3] = replace(recorded[3], phase="reference-corner")
    with RunFile(write(tmp_path / "run.h5", recorded)) as run:
        assert [f.frame_id for f in run.frames("auxiliary")] == [100, 101, 102, 103]
        assert [f.frame_id for f in run.frames("auxiliary", "reference-face")] == [100, 102, 103]
        assert [f.camera for f in run.frames(phase="reference-corner")] == ["auxiliary"]
        assert list(run.frames("auxiliary", "sphere")) == []


def test_table_has_the_metadata_without_the_images(tmp_path):
    recorded = list(frames(6))
    with RunFile(write(tmp_path / "run.h5", recorded)) as run:
        table = run.table()
        assert table["camera"].tolist() == ["primary", "auxiliary"] * 3
        assert table["row"].tolist() == [0, 0, 1, 1, 2, 2]
        assert table["sequence_number"].tolist() == list(range(6))
        assert table["y_mm"].tolist() == [record.y_mm for record in recorded]
        assert table["camera_time_ns"].tolist() == [record.camera_time_ns for record in recorded]


def test_groups_are_means_over_the_frames_that_can_be_trusted(tmp_path):
    recorded = [f for f in frames(24) if f.camera == "primary"]
    bad = replace(recorded[1], status=FrameStatus.INCOMPLETE, y_mm=99.0)
    recorded[1] = bad
    expected = {}
    for record in recorded:
        if record is not bad:
            expected.setdefault(record.target_position, []).append(record)
    with RunFile(write(tmp_path / "run.h5", recorded)) as run:
        groups = {group.target_position: group for group in run.groups("primary", "reference-face")}
    assert list(groups) == list(expected) == [-1, 0, 1, 2, 3, 4]
    for k, group in groups.items():
        images = np.stack([record.data for record in expected[k]])
        assert group.data.dtype == np.float32
        np.testing.assert_array_equal(group.data, images.mean(axis=0, dtype=np.float64).astype(np.float32))
        assert group.count == len(expected[k])
        assert group.peak == images.max()
        assert group.y_mm == pytest.approx(np.mean([record.y_mm for record in expected[k]]), abs=1e-12)
    assert groups[-1].count == 1
    assert groups[0].count == 2


def test_positioners_keep_readings_targets_and_limits(tmp_path):
    path = tmp_path / "run.h5"
    one, two = [f for f in frames(4) if f.camera == "primary"]
    with RunWriter(path, **SETTINGS) as run:
        run.append(one)
        run.set_target("translation", 52.0)
        run.append(two)
    with h5py.File(path) as file:
        stage = file["entry/instrument/translation"]
        assert stage["value"][:].tolist() == [one.y_mm + 50.0, two.y_mm + 50.0]
        assert np.isnan(stage["target_value"][0])
        assert stage["target_value"][1] == 52.0
        assert (stage["soft_limit_min"][()], stage["soft_limit_max"][()]) == (0.0, 100.0)
        assert stage["tolerance"][()] == 0.0025
        assert stage["value"].attrs["units"] == "mm"
        assert file["entry/instrument/rotation/value"].attrs["units"] == "deg"


def test_pressure_at_a_frame_is_interpolated_in_the_log(tmp_path):
    path, base_ns = tmp_path / "run.h5", 1_700_000_000_000_000_000
    image = np.zeros((8, 12), np.uint8)

    def frame(number, at_ns, kpa=float("nan")):
        return FrameRecord("primary", "inflation", image, number, host_time_ns=base_ns + at_ns, pressure_kpa=kpa)

    with RunWriter(path, **SETTINGS, pressure=PRESSURE, flush_every=3) as run:
        run.append(frame(0, -1))
        run.log_pressure(PressureReading(1.0, base_ns))
        run.append(frame(1, 250))
        run.log_pressure(PressureReading(3.0, base_ns + 1000))
        run.append(frame(2, 500, kpa=7.0))
        run.append(frame(3, 1000))
        run.append(frame(4, 1001))
    expected = [np.nan, 1.5, 7.0, 3.0, np.nan]
    with RunFile(path) as run:
        np.testing.assert_array_equal(run.table()["pressure_kpa"], expected)
        np.testing.assert_array_equal([record.pressure_kpa for record in run.frames()], expected)
        times, kpa = run.pressure_log()
        assert times.tolist() == [base_ns, base_ns + 1000]
        assert kpa.tolist() == [1.0, 3.0]
        assert run.verify() is None
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["entry/instrument/pressure/value"][:], expected)
        np.testing.assert_array_equal(
            file["entry/instrument/primary/pressure_kpa"][:], [np.nan, np.nan, 7, np.nan, np.nan]
        )


def test_events_of_any_length_and_script_come_back(tmp_path):
    path = tmp_path / "run.h5"
    texts = ["lamp on", "ä" * 700, "", "µ € 漢字 " * 60 + "end"]
    with RunWriter(path, **SETTINGS) as run:
        for text in texts:
            run.event(text)
    with RunFile(path) as run:
        assert [event.text for event in run.events] == texts
        assert {event.time for event in run.events} == {"2026-03-01T12:00:00.000+00:00"}


TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=900)


@settings(max_examples=5, deadline=None)
@given(texts=st.lists(TEXT, min_size=10, max_size=20))
def test_any_event_comes_back(tmp_path_factory, texts):
    path = tmp_path_factory.mktemp("event") / "run.h5"
    with RunWriter(path, **SETTINGS) as run:
        for text in texts:
            run.event(text)
    with RunFile(path) as run:
        assert [event.text for event in run.events] == texts


def test_checksum_is_that_of_the_documented_bytes(tmp_path):
    """Recomputed here from docs/run-file.md alone, for one frame."""
    image = np.arange(96, dtype=np.uint8).reshape(8, 12)
    record = FrameRecord("primary", "bsc-face", image, 5, 6, 7, target_position=-3, y_mm=-6.0, gain_db=1.5)
    path = write(tmp_path / "run.h5", [record])
    nan = float("nan")
    frame = hashlib.sha256(
        b"primary\nbsc-face\nok\n|u1\n8\n12\0"
        + struct.pack("<3q", 5, 6, 7)
        + struct.pack("<8d", -3.0, -6.0, nan, nan, nan, nan, 1.5, nan)
        + image.tobytes()
    ).hexdigest()
    with RunFile(path) as run, h5py.File(path) as file:
        assert file["entry/instrument/primary/sha256"][0].decode() == frame
        header = file["entry/recording/header_sha256"][()].decode()
        assert run.checksum == hashlib.sha256(f"bscd_run 1\n{header}\n{frame}\n".encode()).hexdigest()


def test_checksum_depends_on_what_was_recorded_and_on_nothing_else(tmp_path):
    def checksum(name, records, **changes):
        with RunFile(write(tmp_path / name, records, **changes)) as run:
            return run.checksum

    first = checksum("a.h5", frames(4))
    assert first == checksum("b.h5", frames(4), run_uuid="other", flush_every=3, program_version="7")
    dark = replace(next(frames(1)), data=np.zeros((8, 12), np.uint8))
    others = [
        checksum("c.h5", frames(4, seed=2)),
        checksum("d.h5", frames(3)),
        checksum("e.h5", frames(4), config_text=""),
        checksum("f.h5", [dark, *list(frames(4))[1:]]),
        checksum("g.h5", reversed(list(frames(4)))),
    ]
    assert len({first, *others}) == 6


def test_a_file_is_never_overwritten(tmp_path):
    path = write(tmp_path / "run.h5", frames(2))
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"exists already.*choose another name"):
        RunWriter(path, **SETTINGS)
    assert path.read_bytes() == before


def test_a_place_that_can_not_be_written_is_told(tmp_path):
    with pytest.raises(InputError, match="no folder"):
        RunWriter(tmp_path / "missing" / "run.h5", **SETTINGS)


def test_a_run_that_can_not_be_begun_leaves_no_file(tmp_path):
    with pytest.raises(ValueError, match="rotation axis is recorded in deg, not in mm"):
        RunWriter(tmp_path / "run.h5", **(SETTINGS | {"axes": {"rotation": AxisMeta("mm")}}))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"camera": "auxiliary"}, "was begun with primary"),
        ({"phase": "reference_corner"}, "no phase 'reference_corner'"),
        ({"data": np.zeros((8, 11), np.uint8)}, "11 x 8 px uint8, the run was begun with 12 x 8 px uint8"),
        ({"data": np.zeros((8, 12), np.uint16)}, "uint16"),
    ],
)
def test_a_frame_that_does_not_fit_is_refused_and_the_run_goes_on(tmp_path, change, told):
    good = next(frames(1))
    with RunWriter(tmp_path / "run.h5", **(SETTINGS | {"cameras": {"primary": CAMERAS["primary"]}})) as run:
        run.append(good)
        with pytest.raises(InputError, match=told):
            run.append(replace(good, **change))
        run.append(good)
    with RunFile(tmp_path / "run.h5") as run:
        assert len(run.table()) == 2
        assert run.verify() is None


def test_sixteen_bit_views_that_are_not_contiguous_are_kept_exactly(tmp_path):
    data = np.arange(240, dtype=np.uint16).reshape(20, 12)[::-2, ::-1]
    cameras = {"primary": CameraMeta(width_px=12, height_px=10, bit_depth=16)}
    path = write(tmp_path / "run.h5", [FrameRecord("primary", "sphere", data, 0)], cameras=cameras)
    with RunFile(path) as run:
        np.testing.assert_array_equal(next(run.frames()).data, data)
        assert run.verify() is None


def test_an_empty_run_can_be_read(tmp_path):
    with RunFile(write(tmp_path / "run.h5", [])) as run:
        assert list(run.frames()) == list(run.groups()) == []
        assert len(run.table()) == 0
        assert run.complete
        assert run.verify() is None
