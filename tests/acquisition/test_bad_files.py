"""Files that are no run files, or were changed or damaged: one sentence each, never a traceback of HDF5."""

import re

import h5py
import pytest

from bscd.acquisition import RunFile, RunWriter
from bscd.errors import InputError
from tests.acquisition.run_records import PRESSURE, SETTINGS, frames


@pytest.fixture
def path(tmp_path):
    with RunWriter(tmp_path / "run.h5", **SETTINGS, pressure=PRESSURE) as run:
        for record in frames(6):
            run.append(record)
    return tmp_path / "run.h5"


def opened(path):
    with RunFile(path) as run:
        list(run.frames())
        list(run.groups())
        return run.verify(), run.events, run.checksum


@pytest.mark.parametrize("opening", [opened, RunWriter.reopen])
@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda path: None, "does not exist; check the name"),
        (lambda path: path.mkdir(), "is a folder, not a run file; make one of it with bscd import"),
        (lambda path: path.write_bytes(b""), "is not an HDF5 file"),
        (lambda path: path.write_text("file,camera\n"), "is not an HDF5 file"),
        (lambda path: h5py.File(path, "w").close(), "is not a run file of bscd"),
    ],
)
def test_what_is_no_run_file(tmp_path, opening, make, told):
    make(tmp_path / "x.h5")
    with pytest.raises(InputError, match=told) as caught:
        opening(tmp_path / "x.h5")
    assert "\n" not in str(caught.value)
    assert "x.h5" in str(caught.value)


def test_a_file_of_another_kind_is_named(tmp_path):
    with h5py.File(tmp_path / "cal.h5", "w") as file:
        file["entry/definition"] = "bscd_calibration"
    with pytest.raises(InputError, match="it is a 'bscd_calibration' file"):
        RunFile(tmp_path / "cal.h5")


def test_a_version_of_the_future_is_refused(path):
    with h5py.File(path, "r+") as file:
        file["entry/definition"].attrs["version"] = "2"
    with pytest.raises(InputError, match="version '2', this program reads version 1"):
        RunFile(path)


@pytest.mark.parametrize("missing", ["entry/title", "entry/instrument", "entry/recording/state", "entry/recipe/data"])
def test_a_run_file_without_a_part_is_refused(path, missing):
    with h5py.File(path, "r+") as file:
        del file[missing]
    with pytest.raises(InputError, match="is damaged"):
        RunFile(path)


def test_every_truncation_is_told(path):
    """At any length below its own a file says so and never raises anything but `InputError`."""
    whole = path.read_bytes()
    cut = path.with_name("cut.h5")
    for length in [1, 7, 8, 48, 100, *range(500, len(whole), len(whole) // 40), len(whole) - 1]:
        cut.write_bytes(whole[:length])
        with pytest.raises(InputError) as caught:
            opened(cut)
        assert "\n" not in str(caught.value)


def change_pixel(file):
    file["entry/instrument/primary/data"][1, 3, 4] ^= 1


def change_reading(file):
    file["entry/instrument/auxiliary/y_mm"][2] += 1e-12


def change_phase(file):
    file["entry/instrument/primary/phase"][0] = b"bsc-face"


def swap(file):
    column = file["entry/instrument/primary/sequence_number"]
    column[0], column[1] = column[1], column[0]


def change_configuration(file):
    del file["entry/configuration/data"]
    file["entry/configuration/data"] = "[target]\npitch_mm = 2.1\n"


def lose_frame(file):
    for item in file["entry/instrument/auxiliary"].values():
        if isinstance(item, h5py.Dataset) and item.maxshape and item.maxshape[0] is None:
            item.resize(2, axis=0)


def add_reading(file):
    for name, value in (("time", 5), ("value", 1.0)):
        log = file[f"entry/instrument/pressure/value_log/{name}"]
        log.resize(1, axis=0)
        log[0] = value


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (change_pixel, r"frame 2 \(primary camera, frame id 101\) is not what was recorded"),
        (change_reading, r"frame 5 \(auxiliary camera, frame id 102\) is not what was recorded"),
        (change_phase, r"frame 0 \(primary camera, frame id 100\) is not what was recorded"),
        (change_configuration, "its title, configuration, recipe or devices are not what was recorded"),
        (swap, "missing or were exchanged"),
        (lose_frame, "missing or were exchanged"),
        (add_reading, "missing or were exchanged"),
    ],
)
def test_the_first_difference_is_named(path, change, told):
    with RunFile(path) as run:
        assert run.verify() is None
    with h5py.File(path, "r+") as file:
        change(file)
    with RunFile(path) as run:
        difference = run.verify()
    assert difference is not None
    assert re.search(told, difference)
