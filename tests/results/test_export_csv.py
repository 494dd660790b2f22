"""The tables as the csv module and numpy read them."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bscd.errors import InputError
from bscd.results import FrameResult, ResultsFile
from bscd.results.export import export_csv
from bscd.results.export.csv import csv_text
from tests.results.measured import frames, grid_px, write

HEAD = (
    "x_px,y_px,x_mm,y_mm,z_mm,dx_mm,dy_mm,dz_mm,u_mm,v_mm,w_mm,exx,eyy,exy,e1,e2,"
    "sigma_x_mm,sigma_y_mm,sigma_z_mm,zncc,epipolar_px,valid"
)


def columns(points_px, frame):
    """What the columns must hold, as float64 ``(N, 22)``."""
    parts = [points_px, frame.xyz_mm, frame.displacement_mm, frame.uvw_mm, frame.strain, frame.principal]
    parts += [frame.sigma_mm, frame.zncc[:, None], frame.epipolar_px[:, None], (frame.status == 0)[:, None]]
    return np.hstack([np.asarray(part, np.float64) for part in parts])


@pytest.fixture
def exported(tmp_path):
    with ResultsFile(write(tmp_path / "r.h5", 5)) as results:
        return export_csv(results, tmp_path / "tables")


def test_a_file_a_frame_named_by_its_number(exported, tmp_path):
    assert [path.name for path in exported] == [f"frame_{k:04d}.csv" for k in (3, 4, 5, 6, 7)]
    assert sorted((tmp_path / "tables").iterdir()) == list(exported)


def test_the_csv_module_finds_every_point_in_every_frame(exported):
    for path, frame in zip(exported, frames(5), strict=True):
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(rows[0]) == HEAD.split(",")
        assert len(rows) == 20
        assert [(float(row["x_px"]), float(row["y_px"])) for row in rows] == [tuple(p) for p in grid_px()]
        assert [row["valid"] for row in rows] == [str(int(code == 0)) for code in frame.status]
        for row, known in zip(rows, ~np.isnan(frame.xyz_mm[:, 0]), strict=True):
            assert (row["x_mm"] != "") == (row["w_mm"] != "") == (row["zncc"] != "") == known


def test_numpy_reads_what_was_measured_to_the_last_bit(exported):
    for path, frame in zip(exported, frames(5), strict=True):
        table = np.genfromtxt(path, delimiter=",", names=True)
        assert list(table.dtype.names) == HEAD.split(",")
        read, expected = np.array(table.tolist()), columns(grid_px(), frame)
        single = [*range(11, 21)]
        np.testing.assert_array_equal(read[:, :11], expected[:, :11])
        np.testing.assert_array_equal(read[:, single].astype(np.float32), expected[:, single].astype(np.float32))
        np.testing.assert_array_equal(read[:, 21], expected[:, 21])


def test_a_point_that_is_not_valid_keeps_what_is_known_of_it(tmp_path):
    frame = next(frames(1))
    status = np.where(np.arange(20) == 0, 2, frame.status).astype(np.uint8)
    with ResultsFile(write(tmp_path / "r.h5", measured=[replace(frame, status=status)])) as results:
        (path,) = export_csv(results, tmp_path)
    first = path.read_text().splitlines()[1].split(",")
    assert float(first[2]) == frame.xyz_mm[0, 0]
    assert first[-1] == "0"


NUMBERS = st.floats(allow_infinity=False)


@settings(max_examples=50, deadline=None)
@given(xyz_mm=hnp.arrays(np.float64, (4, 3), elements=NUMBERS), zncc=hnp.arrays(np.float32, 4))
def test_any_number_reads_back_the_same(xyz_mm, zncc):
    frame = replace(FrameResult.unknown(0, 4, 0), xyz_mm=xyz_mm, zncc=zncc)
    lines = csv_text(grid_px()[:4], frame).splitlines()
    cells = [line.split(",") for line in lines[1:]]
    read_mm = np.array([[float(cell or "nan") for cell in row[2:5]] for row in cells])
    np.testing.assert_array_equal(read_mm, xyz_mm)
    np.testing.assert_array_equal(np.array([float(row[19] or "nan") for row in cells]).astype(np.float32), zncc)
    assert all(set(row[5:19]) == {""} for row in cells)


def test_nothing_is_overwritten(exported, tmp_path):
    before = exported[2].read_bytes()
    exported[0].unlink()
    with (
        ResultsFile(tmp_path / "r.h5") as results,
        pytest.raises(
            InputError, match=r"tables/frame_0004.csv exists already and nothing is overwritten; choose a new"
        ),
    ):
        export_csv(results, tmp_path / "tables")
    assert exported[2].read_bytes() == before
    assert not exported[0].exists()


def test_other_files_in_the_folder_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with ResultsFile(write(tmp_path / "r.h5", 2)) as results:
        export_csv(results, tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert len(list(tmp_path.glob("frame_*.csv"))) == 2


def test_an_export_that_fails_leaves_nothing(tmp_path):
    def fail(done, total, doing):
        if done == 2:
            raise InputError(f"stopped at {doing} of {total}")

    with ResultsFile(write(tmp_path / "r.h5", 3)) as results:
        with pytest.raises(InputError, match="stopped at frame 4 of 3"):
            export_csv(results, tmp_path / "new" / "tables", fail)
        assert not (tmp_path / "new" / "tables").exists()
        (tmp_path / "old").mkdir()
        with pytest.raises(InputError, match="stopped"):
            export_csv(results, tmp_path / "old", fail)
        assert list((tmp_path / "old").iterdir()) == []


def test_progress_counts_the_frames(tmp_path):
    told = []
    with ResultsFile(write(tmp_path / "r.h5", 3)) as results:
        export_csv(results, tmp_path / "tables", lambda *now: told.append(now))
    assert told == [(1, 3, "frame 3"), (2, 3, "frame 4"), (3, 3, "frame 5")]
