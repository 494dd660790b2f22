"""Files that are no results, or were changed or damaged: one sentence each, never a traceback of HDF5."""

import re

import h5py
import pytest

from bscd.acquisition import RunFile
from bscd.errors import InputError
from bscd.results import ResultsFile
from tests.results.measured import write


@pytest.fixture
def path(tmp_path):
    return write(tmp_path / "results.h5", 4)


def opened(path):
    with ResultsFile(path) as results:
        list(results.frames())
        return results.verify(), results.checksum, results.array("strain")


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda path: None, "does not exist; check the name"),
        (lambda path: path.mkdir(), "is a folder, not a results file; give the file that bscd measure made"),
        (lambda path: path.write_bytes(b""), "is not an HDF5 file; give a file of bscd measure"),
        (lambda path: path.write_text("x_px,y_px\n"), "is not an HDF5 file"),
        (lambda path: h5py.File(path, "w").close(), r"is not a results file of bscd \(it names no definition\)"),
    ],
)
def test_what_is_no_results_file(tmp_path, make, told):
    make(tmp_path / "x.h5")
    with pytest.raises(InputError, match=told) as caught:
        opened(tmp_path / "x.h5")
    assert "\n" not in str(caught.value)
    assert "x.h5" in str(caught.value)


def test_files_of_the_other_kind_are_named(path, tmp_path):
    with pytest.raises(
        InputError, match=r"is not a run file of bscd \(it is a 'bscd_results' file\); give a file of bscd"
    ):
        RunFile(path)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["entry/definition"] = "bscd_run"
    with pytest.raises(InputError, match=r"is not a results file of bscd \(it is a 'bscd_run' file\)"):
        ResultsFile(tmp_path / "run.h5")


def test_a_version_of_the_future_is_refused(path):
    with h5py.File(path, "r+") as file:
        file["entry/definition"].attrs["version"] = "3"
    with pytest.raises(InputError, match="version '3', this program reads version 2"):
        ResultsFile(path)


@pytest.mark.parametrize(
    "missing",
    [
        "entry/title",
        "entry/data",
        "entry/data/points_px",
        "entry/data/strain",
        "entry/data/frame_number",
        "entry/measurement/run/sha256",
        "entry/measurement/membrane_frame/axes",
        "entry/process/parameters",
        "entry/recording/state",
        "entry/recording/frame_sha256",
    ],
)
def test_a_results_file_without_a_part_is_refused(path, missing):
    with h5py.File(path, "r+") as file:
        del file[missing]
    with pytest.raises(InputError, match="is damaged") as caught:
        ResultsFile(path)
    assert "\n" not in str(caught.value)


def without_codes(file):
    del file["entry/data/status"].attrs["code_names"]


def other_shape(file):
    del file["entry/data/sigma_mm"]
    file["entry/data/sigma_mm"] = [[1.0, 2.0]]


def other_stereo(file):
    del file["entry/measurement/stereo"]
    file["entry/measurement/stereo"] = "mirror"


@pytest.mark.parametrize("change", [without_codes, other_shape, other_stereo])
def test_a_results_file_with_a_wrong_part_is_refused(path, change):
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(InputError, match="is damaged"):
        ResultsFile(path)


def test_every_truncation_is_told(path):
    """At any length below its own a file says so and never raises anything but `InputError`."""
    whole = path.read_bytes()
    cut = path.with_name("cut.h5")
    for length in [1, 7, 8, 48, 100, *range(500, len(whole), len(whole) // 40), len(whole) - 1]:
        cut.write_bytes(whole[:length])
        with pytest.raises(InputError) as caught:
            opened(cut)
        assert "\n" not in str(caught.value)


def change_position(file):
    file["entry/data/xyz_mm"][1, 0, 0] = 1e-12


def change_status(file):
    file["entry/data/status"][2, 3] ^= 1


def change_time(file):
    file["entry/data/time_s"][0] = 0.01


def change_points(file):
    file["entry/data/points_px"][0, 0] += 1.0


def change_parameter(file):
    file["entry/process/parameters"].attrs["subset_px"] = 31


def lose_frame(file):
    for item in file["entry/data"].values():
        if isinstance(item, h5py.Dataset) and item.maxshape and item.maxshape[0] is None:
            item.resize(3, axis=0)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (change_position, "frame 4 is not what was measured"),
        (change_status, "frame 5 is not what was measured"),
        (change_time, "frame 3 is not what was measured"),
        (change_points, "its title, points, parameters or origins are not what was measured"),
        (change_parameter, "its title, points, parameters or origins are not what was measured"),
        (lose_frame, "frames are missing or were exchanged"),
    ],
)
def test_the_first_difference_is_named(path, change, told):
    with ResultsFile(path) as results:
        assert results.verify() is None
    with h5py.File(path, "r+") as file:
        change(file)
    with ResultsFile(path) as results:
        difference = results.verify()
    assert difference is not None
    assert re.search(told, difference)
