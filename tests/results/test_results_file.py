import hashlib
import json
import statistics
import struct
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bscd.errors import BscdError, InputError
from bscd.hdf5 import FileState
from bscd.results import FrameResult, ResultsFile, ResultsWriter
from tests.results.measured import SINGLE, START, frames, grid_px, header, same, with_extrapolated, write

WIDTHS = {"xyz_mm": 3, "displacement_mm": 3, "uvw_mm": 3, "strain": 3, "principal": 2, "principal_direction": 3}
WIDTHS |= {"sigma_mm": 3, "displacement_sigma_mm": 3, "zncc": 0, "epipolar_px": 0, "left_px": 2, "right_px": 2}


def test_every_frame_comes_back_bit_for_bit(tmp_path):
    measured = list(frames(6))
    with ResultsFile(write(tmp_path / "r.h5", measured=measured)) as results:
        assert len(results) == 6
        assert all(same(a, b) for a, b in zip(measured, results.frames(), strict=True))
        assert all(same(measured[k], results.frame(k)) for k in (5, 0, 3))
        assert results.frame_numbers().tolist() == [3, 4, 5, 6, 7, 8]
        assert results.state is FileState.COMPLETE
        assert results.complete
        assert results.verify() is None


@st.composite
def any_frame(draw):
    n = draw(st.integers(1, 6))
    values = {}
    for name, width in WIDTHS.items():
        dtype = np.float32 if name in SINGLE else np.float64
        values[name] = draw(hnp.arrays(dtype, (n, width) if width else n))
    status = draw(hnp.arrays(np.uint8, n, elements=st.sampled_from([0, 1, 2, 7])))
    scalar = st.floats()
    return FrameResult(draw(st.integers(0, 2**40)), draw(scalar), draw(scalar), status=status, **values)


@settings(max_examples=25, deadline=None)
@given(frame=any_frame())
@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
def test_any_values_come_back_bit_for_bit(tmp_path_factory, frame):
    path = tmp_path_factory.mktemp("any") / "r.h5"
    write(path, head=header(points_px=grid_px()[: len(frame.status)]), measured=[frame])
    with ResultsFile(path) as results:
        assert same(results.frame(0), frame)
        assert results.verify() is None


PARAMETERS = st.dictionaries(
    st.text(st.characters(codec="ascii", exclude_characters="\0"), min_size=1).filter(lambda name: name != "NX_class"),
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats()
    | st.text(st.characters(codec="utf-8", exclude_characters="\0")),
    max_size=5,
)


@settings(max_examples=25, deadline=None)
@given(parameters=PARAMETERS)
def test_any_parameters_come_back_with_their_types(tmp_path_factory, parameters):
    path = write(tmp_path_factory.mktemp("any") / "r.h5", 1, header(parameters=parameters))
    with ResultsFile(path) as results:
        found = results.header.parameters
        assert results.verify() is None
    assert {name: type(value) for name, value in found.items()} == {n: type(v) for n, v in parameters.items()}
    assert repr(sorted(found.items(), key=str)) == repr(sorted(parameters.items(), key=str))


def test_header_comes_back(tmp_path):
    head = header(stereo="standard", uuid="0f", program_version="9.9", parameters={"config": "x = 1\n" * 20_000})
    with ResultsFile(write(tmp_path / "r.h5", 2, head)) as results:
        found = results.header
    for name in ("title", "run", "calibration", "status_names", "stereo", "reference_frames", "parameters"):
        assert getattr(found, name) == getattr(head, name), name
    assert (found.uuid, found.program_version, found.start_time) == ("0f", "9.9", "2026-03-01T12:00:00.000+00:00")
    np.testing.assert_array_equal(found.points_px, head.points_px)
    np.testing.assert_array_equal(found.membrane.axes, head.membrane.axes)
    np.testing.assert_array_equal(found.membrane.origin_mm, head.membrane.origin_mm)


def test_what_was_not_known_is_not_there(tmp_path):
    path = write(tmp_path / "r.h5", 1, header(membrane=None, reference_frames=(), parameters={}))
    with ResultsFile(path) as results:
        assert results.header.membrane is None
        assert results.header.reference_frames == ()
        assert results.header.parameters == {}
        assert len(results.uuid) == 36


def test_parameters_stand_as_json_too(tmp_path):
    with h5py.File(write(tmp_path / "r.h5", 1)) as file:
        told = json.loads(file["entry/process/parameters/json"][()])
    assert told == {"subset_px": 21, "step_px": 10.0, "extrapolate": False, "order": "affine", "radius_mm": None}


def test_one_quantity_over_all_frames(tmp_path):
    measured = list(frames(4))
    with ResultsFile(write(tmp_path / "r.h5", measured=measured)) as results:
        np.testing.assert_array_equal(results.array("xyz_mm"), [frame.xyz_mm for frame in measured])
        np.testing.assert_array_equal(results.array("status"), [frame.status for frame in measured])
        np.testing.assert_array_equal(results.array("time_s"), [frame.time_s for frame in measured])
        valid = [frame.valid for frame in measured]
        np.testing.assert_allclose(results.array("valid_fraction"), np.mean(valid, axis=1))
        moved = [np.linalg.norm(frame.displacement_mm[frame.valid], axis=1) for frame in measured]
        moved = [d.max() if len(d) else np.nan for d in moved]
        np.testing.assert_allclose(results.array("displacement_max_mm"), moved)
        beside = [frame.epipolar_px[np.isfinite(frame.epipolar_px)] for frame in measured]
        middle = [statistics.median(px.tolist()) if len(px) else np.nan for px in beside]
        np.testing.assert_allclose(results.array("epipolar_median_px"), middle, rtol=1e-6)
        with pytest.raises(ValueError, match="no quantity 'w_mm'; there are xyz_mm, "):
            results.array("w_mm")
        with pytest.raises(IndexError, match="has 4 frames, there is none at 4"):
            results.frame(4)


def test_shapes_types_and_codes_are_those_of_the_design(tmp_path):
    with h5py.File(write(tmp_path / "r.h5", 3)) as file:
        data = file["entry/data"]
        n, t = 20, 3
        shapes = {"points_px": (n, 2), "zncc": (t, n), "epipolar_px": (t, n), "status": (t, n)}
        shapes |= dict.fromkeys(("xyz_mm", "displacement_mm", "uvw_mm", "strain"), (t, n, 3))
        shapes |= dict.fromkeys(("sigma_mm", "displacement_sigma_mm"), (t, n, 3))
        shapes |= {"time_s": (t,), "pressure_kpa": (t,)}
        assert {name: data[name].shape for name in shapes} == shapes
        named = dict(zip(data["status"].attrs["codes"], data["status"].attrs["code_names"], strict=True))
        assert named == header().status_names
        assert data["xyz_mm"].chunks == (1, n, 3)
        assert data["xyz_mm"].maxshape == (None, n, 3)
        assert data["xyz_mm"].id.get_num_chunks() == 3
        assert (data["xyz_mm"].dtype, data["sigma_mm"].dtype, data["status"].dtype) == ("<f8", "<f4", "u1")
        assert file["entry/measurement/run/sha256"][()] == b"ab" * 32
        assert file["entry/measurement/calibration/sha256"][()] == b"cd" * 32


def test_extrapolated_points_are_told_from_valid_and_lost_ones(tmp_path):
    measured = with_extrapolated(next(frames(1)), 7)
    path = write(tmp_path / "r.h5", measured=[measured])
    with ResultsFile(path) as results:
        frame = results.frame(0)
    assert np.flatnonzero(frame.extrapolated).tolist() == [7]
    assert not frame.valid[7]
    with h5py.File(path) as file:  # as the documentation says, from the file alone
        data = file["entry/data"]
        known = np.isfinite(data["xyz_mm"][0]).all(axis=1)
        assert np.flatnonzero(known & (data["status"][0] != 0)).tolist() == [7]


def test_a_frame_of_which_nothing_is_known(tmp_path):
    lost = FrameResult.unknown(3, 20, 7, time_s=0.5)
    with ResultsFile(write(tmp_path / "r.h5", measured=[replace(lost, zncc=np.full(20, 0.5))])) as results:
        frame = results.frame(0)
        assert np.isnan(frame.xyz_mm).all()
        assert frame.zncc.tolist() == [0.5] * 20
        assert not frame.valid.any()
        assert np.isnan(frame.pressure_kpa)
        assert np.isnan(results.array("displacement_max_mm")).all()


def test_results_are_never_overwritten(tmp_path):
    path = write(tmp_path / "r.h5", 2)
    before = path.read_bytes()
    with pytest.raises(InputError, match="exists already and results are never overwritten"):
        ResultsWriter(path, header())
    assert path.read_bytes() == before


def test_there_is_no_file_where_the_header_is_wrong(tmp_path):
    for wrong, told in (
        ({"points_px": np.zeros((0, 2))}, r"points_px is \(0, 2\)"),
        ({"points_px": np.zeros((4, 3))}, r"points_px is \(4, 3\)"),
        ({"status_names": {1: "lost"}}, "0 is among them"),
        ({"status_names": {0: "valid", 255: "lost"}}, "codes are 0 to 254"),
        ({"parameters": {"radius_mm": None}}, "parameter 'radius_mm' is None, not a number or a text"),
        ({"membrane": replace(header().membrane, axes=np.eye(2))}, "axes"),
    ):
        with pytest.raises(ValueError, match=told):
            ResultsWriter(tmp_path / "r.h5", header(**wrong))
    with pytest.raises(InputError, match="there is no folder"):
        ResultsWriter(tmp_path / "none" / "r.h5", header())
    assert list(tmp_path.iterdir()) == []


def test_a_frame_that_does_not_fit_is_refused_and_the_file_goes_on(tmp_path):
    one, two = frames(2)
    with ResultsWriter(tmp_path / "r.h5", header(), now=lambda: START) as results:
        results.append(one)
        for wrong, told in (
            (one, "frame 3 comes after frame 3"),
            (replace(two, sigma_mm=two.sigma_mm[:, :2]), r"sigma_mm is \(20, 2\), not \(20, 3\)"),
            (replace(two, status=np.full(20, 5, np.uint8)), r"status codes \[5\] have no name"),
        ):
            with pytest.raises(ValueError, match=told):
                results.append(wrong)
        results.append(two)
        assert results.frames_written == 2
    with ResultsFile(tmp_path / "r.h5") as read:
        assert same(read.frame(1), two)
        assert read.verify() is None


def test_an_exception_leaves_readable_results_with_the_reason(tmp_path):
    path = tmp_path / "r.h5"
    with pytest.raises(RuntimeError, match="burst"), ResultsWriter(path, header(), flush_every=10) as results:
        for frame in frames(3):
            results.append(frame)
        raise RuntimeError("the membrane burst")
    with ResultsFile(path) as read:
        assert (read.state, read.reason) == (FileState.INTERRUPTED, "the membrane burst")
        assert len(read) == 3
        assert read.verify() is None
        assert len(read.checksum) == 64
    with pytest.raises(BscdError, match="have ended; measure into a new file"):
        results.append(next(frames(1)))


def test_the_checksum_is_that_of_the_documentation(tmp_path):
    """Recomputed from the file alone, as docs/results-file.md says."""
    path = write(tmp_path / "r.h5", 3)
    order = "xyz_mm displacement_mm uvw_mm strain principal principal_direction sigma_mm displacement_sigma_mm zncc"
    order += " epipolar_px status left_px right_px"
    with h5py.File(path) as file:
        data, recording = file["entry/data"], file["entry/recording"]
        over = hashlib.sha256(b"bscd_results 2\n" + recording["header_sha256"][()] + b"\n")
        for k in range(3):
            digest = hashlib.sha256(struct.pack("<q", data["frame_number"][k]))
            digest.update(struct.pack("<2d", data["time_s"][k], data["pressure_kpa"][k]))
            for name in order.split():
                digest.update(data[name][k].tobytes())
            assert recording["frame_sha256"][k] == digest.hexdigest().encode()
            over.update(digest.hexdigest().encode() + b"\n")
        assert recording["sha256"][()] == over.hexdigest().encode()


def test_the_checksum_depends_on_what_was_measured_and_on_nothing_else(tmp_path):
    def checksum(name, **changes):
        with ResultsFile(write(tmp_path / name, 3, header(**changes))) as results:
            return results.checksum

    assert checksum("a.h5") == checksum("b.h5", uuid="other", start_time="2020", program_version="2")
    assert checksum("c.h5", parameters={}) != checksum("d.h5")
    assert checksum("e.h5", points_px=grid_px() + 1e-9) != checksum("f.h5")


def test_memory_does_not_grow_with_the_frames(tmp_path):
    head, measured = header(points_px=grid_px(40, 40)), list(frames(2, grid_px(40, 40)))
    with ResultsWriter(tmp_path / "r.h5", head, flush_every=5) as results:
        results.append(measured[0])
        tracemalloc.start()
        for number in range(40):
            results.append(replace(measured[1], number=number + 10))
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert grown < 200_000  # a frame is 254 kB, forty of them 10 MB


def test_neither_does_hdf5_keep_what_was_written(tmp_path):
    code = f"""
from dataclasses import replace
from pathlib import Path
from bscd.results import ResultsWriter
from tests.results.measured import frames, grid_px, header

def resident_mb():
    return int(next(l for l in open("/proc/self/status") if l.startswith("VmRSS")).split()[1]) / 1024

points = grid_px(40, 40)
with ResultsWriter(Path({str(tmp_path / "r.h5")!r}), header(points_px=points), flush_every=11) as results:
    first, measured = frames(2, points)
    results.append(first)
    for number in range(300):
        results.append(replace(measured, number=number + 10))
        if number == 20:
            before = resident_mb()
    print(resident_mb() - before)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    )
    assert float(done.stdout) < 15.0  # it was written 70 MB
