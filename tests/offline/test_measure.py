"""`bscd.measure` and what it returns, held against the results file that it comes from."""

import gc
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

import bscd
from bscd.acquisition import RunFile
from bscd.errors import InputError
from bscd.procedures import Progress
from tests.results.measured import frames, header, same, with_extrapolated, write

ARRAYS = {"xyz_mm": 3, "displacement_mm": 3, "uvw_mm": 3, "strain": 3, "principal": 2, "sigma_mm": 3}
ARRAYS |= {"displacement_sigma_mm": 3, "zncc": 0, "epipolar_px": 0, "left_px": 2, "right_px": 2, "status": 0}


@pytest.fixture(scope="module")
def measured(files: Path, tmp_path_factory):
    out = tmp_path_factory.mktemp("measured") / "results.h5"
    with bscd.measure(files / "cal.h5", files / "run.h5", out=out, step_px=25, vsg_mm=9.0) as found:
        yield found


def test_arrays_are_those_of_the_results_file(measured):
    t, n = 3, len(measured.points_px)
    assert len(measured) == t
    with h5py.File(measured.path) as file:
        for name, width in ARRAYS.items():
            found = getattr(measured, name)
            assert found.shape == ((t, n, width) if width else (t, n))
            np.testing.assert_array_equal(found, file[f"entry/data/{name}"])
        for name in ("points_px", "time_s", "pressure_kpa"):
            np.testing.assert_array_equal(getattr(measured, name), file[f"entry/data/{name}"])
        np.testing.assert_array_equal(measured.valid, file["entry/data/status"][:] == 0)
    assert measured.pressure_kpa.tolist() == [0.05, 0.05, 1.8]
    assert 1.0 < np.nanmax(measured.uvw_mm[-1, :, 2]) < 4.0


def test_an_array_is_read_once(measured):
    assert measured.zncc is measured.zncc


def test_frames_one_at_a_time(measured):
    read = list(measured.frames())
    assert [frame.number for frame in read] == measured.frame_numbers.tolist() == [0, 1, 2]
    assert same(measured.frame(-1), read[2])
    assert same(measured.frame(0), read[0])
    for index in (3, -4):
        with pytest.raises(IndexError):
            measured.frame(index)


def test_settings_and_origins_are_kept(measured, files):
    assert measured.header.parameters["step_px"] == 25
    assert measured.header.calibration.file_name == "cal.h5"
    assert measured.header.run.file_name == "run.h5"
    assert measured.results.complete
    assert measured.results.verify() is None
    assert repr(measured) == f"<MeasuredRun 'inflation of run': 3 frames of {len(measured.points_px)} points>"


def test_opened_objects_do_as_well_as_paths(measured, files, wide):
    seen: list[Progress] = []
    with RunFile(files / "run.h5") as run:
        with bscd.measure(wide, run, step_px=25, vsg_mm=9.0, progress=seen.append) as again:
            np.testing.assert_array_equal(again.xyz_mm, measured.xyz_mm)
        assert len(run.table()) == 3  # it is still open
    assert [progress.done for progress in seen] == [1, 2, 3]


class TestTemporaryFile:
    def test_goes_when_it_is_closed(self, files):
        found = bscd.measure(files / "cal.h5", files / "run.h5", step_px=50, strain=False)
        folder = found.path.parent
        assert found.path.is_file()
        found.close()
        found.close()
        assert not folder.exists()

    def test_goes_with_the_object(self, files):
        found = bscd.measure(files / "cal.h5", files / "run.h5", step_px=50, strain=False)
        folder, kept = found.path.parent, found.xyz_mm
        del found
        gc.collect()
        assert not folder.exists()
        assert np.isfinite(kept).any()

    def test_does_not_stay_when_measuring_fails(self, files, tmp_path, monkeypatch):
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        with pytest.raises(InputError, match="it has no sphere frames"):
            bscd.measure(files / "cal.h5", files / "run.h5", phase="sphere")
        assert list(tmp_path.iterdir()) == []


def test_a_results_file_stays(files, measured):
    with bscd.open_results(measured.path) as opened:
        assert len(opened) == 3
    assert measured.path.is_file()


def test_refused(files, measured, tmp_path):
    with pytest.raises(InputError, match="exists already; results are never overwritten"):
        bscd.measure(files / "cal.h5", files / "run.h5", out=measured.path)
    with pytest.raises(TypeError, match="step_mm"):
        bscd.measure(files / "cal.h5", files / "run.h5", step_mm=1)
    with pytest.raises(InputError, match="is not a results file"):
        bscd.open_results(files / "run.h5")


def test_warnings_are_pythons_own(files, wide):
    with pytest.warns(UserWarning, match="no strains: a virtual strain gauge of 1 mm has no room"):
        bscd.measure(wide, files / "run.h5", step_px=50, vsg_mm=1.0).close()


class TestTable:
    def test_a_row_a_point_of_every_frame(self, measured):
        table, n = measured.table(), len(measured.points_px)
        assert isinstance(table, pd.DataFrame)
        assert len(table) == 3 * n
        np.testing.assert_array_equal(table["frame"], np.repeat([0, 1, 2], n))
        np.testing.assert_array_equal(table["point"], np.tile(np.arange(n), 3))
        np.testing.assert_array_equal(table["pressure_kpa"], np.repeat(measured.pressure_kpa, n))
        np.testing.assert_array_equal(table[["x_px", "y_px"]], np.tile(measured.points_px, (3, 1)))
        for names, array in {
            ("x_mm", "y_mm", "z_mm"): measured.xyz_mm,
            ("dx_mm", "dy_mm", "dz_mm"): measured.displacement_mm,
            ("u_mm", "v_mm", "w_mm"): measured.uvw_mm,
            ("exx", "eyy", "exy"): measured.strain,
            ("e1", "e2"): measured.principal,
            ("sigma_x_mm", "sigma_y_mm", "sigma_z_mm"): measured.sigma_mm,
            ("sigma_dx_mm", "sigma_dy_mm", "sigma_dz_mm"): measured.displacement_sigma_mm,
            ("zncc",): measured.zncc,
            ("epipolar_px",): measured.epipolar_px,
            ("valid",): measured.valid,
        }.items():
            np.testing.assert_array_equal(table[list(names)], array.reshape(3 * n, len(names)))
        assert (table["status"] == "valid").tolist() == measured.valid.ravel().tolist()

    def test_pandas_groups_it_by_frame(self, measured):
        table = measured.table()
        w_mm = table[table["valid"]].groupby("frame")["w_mm"].max()
        np.testing.assert_array_equal(
            w_mm, [np.max(w[v, 2]) for w, v in zip(measured.uvw_mm, measured.valid, strict=True)]
        )

    def test_of_one_frame(self, measured):
        last = measured.table(-1)
        assert set(last["frame"]) == {2}
        pd.testing.assert_frame_equal(last, measured.table(2))

    def test_its_columns_begin_as_those_of_the_csv_export(self, measured):
        from bscd.results.export.csv import COLUMNS

        names = [name for name in measured.table(0).columns if not name.startswith("sigma_d")]
        assert names[4:-2] == COLUMNS.split(",")

    def test_tells_extrapolated_points_apart(self, tmp_path):
        path = write(tmp_path / "r.h5", measured=[with_extrapolated(next(frames(1)), 7)])
        with bscd.open_results(path) as opened:
            table = opened.table()
            assert table.index[table["extrapolated"]].tolist() == [7]
            assert table["status"][7] == "outside the calibrated hull"
            assert opened.extrapolated[0].tolist() == table["extrapolated"].tolist()
            assert opened.counts.extrapolated == 1
            assert opened.counts.valid == int(table["valid"].sum())

    def test_of_results_without_a_frame(self, tmp_path):
        with bscd.open_results(write(tmp_path / "r.h5", 0, header())) as opened:
            assert opened.table().empty
            assert opened.xyz_mm.shape == (0, 20, 3)
