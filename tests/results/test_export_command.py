import os
import subprocess
import sys
from pathlib import Path

import pytest

from bscd.cli.app import run
from bscd.results import ResultsWriter
from tests.results.measured import frames, header, write

BSCD = Path(sys.executable).with_name("bscd")


@pytest.fixture
def results(tmp_path):
    return write(tmp_path / "ball.h5", 3)


@pytest.mark.parametrize(
    ("to", "names", "told"),
    [
        ("csv", ["frame_0003.csv", "frame_0004.csv", "frame_0005.csv"], "in 3 files, frame_0003.csv to frame_0005.csv"),
        (
            "vtk",
            ["ball.pvd", "frame_0003.vtu", "frame_0004.vtu", "frame_0005.vtu"],
            "in 4 files, frame_0003.vtu to ball.pvd",
        ),
        ("mat", ["DIC3DPPresults_1Pairs.mat"], "in DIC3DPPresults_1Pairs.mat"),
    ],
)
def test_each_format(results, tmp_path, capsys, to, names, told):
    folder = tmp_path / "new" / "folder"
    assert run(["export", str(results), "--to", to, str(folder)]) == 0
    assert sorted(path.name for path in folder.iterdir()) == names
    said = capsys.readouterr()
    assert said.out == f"{folder}: 3 frames of 20 points {told}\n"
    assert said.err.splitlines()[0] == "Export: 3 frames"
    assert "3/3 frames" in said.err


def test_all_formats_go_into_one_folder_and_none_twice(results, tmp_path, capsys):
    for to in ("csv", "vtk", "mat"):
        assert run(["export", str(results), str(tmp_path / "out"), "--to", to]) == 0
        capsys.readouterr()
        assert run(["export", str(results), str(tmp_path / "out"), "--to", to]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"error: {tmp_path}/out/")
        assert "exists already and nothing is overwritten" in line


def test_results_that_are_not_complete_are_exported_with_a_warning(tmp_path, capsys):
    path = tmp_path / "r.h5"
    with pytest.raises(RuntimeError), ResultsWriter(path, header()) as writer:
        writer.append(next(frames(1)))
        raise RuntimeError("the membrane burst")
    assert run(["export", str(path), str(tmp_path / "out"), "--to", "csv"]) == 0
    said = capsys.readouterr()
    assert f"warning: {path} is not complete (the membrane burst); what it holds is exported" in said.err
    assert said.out.endswith("1 frames of 20 points in frame_0003.csv\n")


def cut(path, folder):
    path.write_bytes(path.read_bytes()[:-100])


def not_there(path, folder):
    path.unlink()


def run_file(path, folder):
    path.write_text("file,camera\n")


def no_frame(path, folder):
    path.unlink()
    ResultsWriter(path, header()).close()


def file_in_the_way(path, folder):
    folder.write_text("mine")


def no_place(path, folder):
    folder.parent.chmod(0o500)


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (cut, "is cut off"),
        (not_there, "does not exist; check the name"),
        (run_file, "is not an HDF5 file; give a file of bscd measure"),
        (no_frame, "holds no frame; measure one first"),
        (file_in_the_way, "is a file, not a folder; choose another name"),
        pytest.param(
            no_place,
            "can not be made a folder (Permission denied)",
            marks=pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere"),
        ),
    ],
)
@pytest.mark.parametrize("to", ["csv", "vtk", "mat"])
def test_what_is_wrong_is_one_line_and_exit_code_1(results, tmp_path, capsys, spoil, told, to):
    folder = tmp_path / "place" / "out"
    folder.parent.mkdir()
    spoil(results, folder)
    before = sorted(tmp_path.rglob("*"))
    assert run(["export", str(results), str(folder), "--to", to]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert told in line
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "arguments", [[], ["r.h5"], ["r.h5", "out"], ["r.h5", "out", "--to", "xls"], ["r.h5", "--to", "csv"]]
)
def test_bad_usage_ends_with_2(capsys, arguments):
    assert run(["export", *arguments]) == 2
    capsys.readouterr()


def test_the_installed_command(results, tmp_path):
    done = subprocess.run(
        [BSCD, "export", results, "--to", "csv", tmp_path / "tables"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "tables").glob("*.csv"))) == 3
