"""The .mat file as scipy reads it, field by field as MultiDIC's functions use it.

`multidic_uses` is what its plot3DDICPPresults reaches: anim8_DIC3DPP_faceMeasure, ..._faceMeasureDirection,
..._pointMeasure and the functions that draw on images (MultiDIC on GitHub, lib_MultiDIC).
"""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
import scipy.io

from bscd.errors import InputError
from bscd.results import ResultsFile
from bscd.results.export import export_matlab
from bscd.results.export.matlab import _NUMBERS_OF_TENSORS, _NUMBERS_PER_FACE, _NUMBERS_PER_POINT
from bscd.results.export.surface import triangulate
from bscd.results.export.triangle_deformation import triangle_deformation
from tests.results.measured import frames, grid_px, header, reference_mm, with_extrapolated, write

T, N = 5, 20
FACES = triangulate(grid_px())
M = len(FACES)

FACE_MEASURES = ["J", "Lamda1", "Lamda2", "Emgn", "emgn", "Eeq", "eeq", "EShearMax", "eShearMax"]
FACE_MEASURES += ["Epc1", "Epc2", "epc1", "epc2"]
TENSORS = ["Fmat", "Cmat", "Emat", "emat"]
FACE_DIRECTIONS = ["Epc1vecCur", "Epc2vecCur", "epc1vec", "epc2vec"]


def multidic_uses():
    """(path, shape of the cell array or None, shape of the value)."""
    yield "Faces", None, (M, 3)
    yield "FaceColors", None, (M, 1)
    yield "FacePairInds", None, (M, 1)
    yield "PointPairInds", None, (N, 1)
    yield "pairIndices", None, (1, 2)
    for name, shape in (("Points3D", (N, 3)), ("corrComb", (N, 1))):
        yield name, (T, 1), shape
    for name, shape in (
        ("Points3D_ARBM", (N, 3)),
        ("FaceCorrComb", (M, 1)),
        ("FaceIsoInd", (M, 1)),
        ("FaceCentroids", (M, 3)),
        ("FaceCentroids_ARBM", (M, 3)),
        ("Disp.DispVec", (N, 3)),
        ("Disp.DispMgn", (N, 1)),
        ("Disp.DispVec_ARBM", (N, 3)),
        ("Disp.DispMgn_ARBM", (N, 1)),
        ("RBM.RotMat", (3, 3)),
        ("RBM.TransVec", (3, 1)),
    ):
        yield name, (1, T), shape
    for name in FACE_MEASURES:
        yield f"Deform.{name}", (T, 1), (M, 1)
    for name in FACE_MEASURES + FACE_DIRECTIONS:
        yield f"Deform_ARBM.{name}", (T, 1), (M, 3 if "vec" in name else 1)
    for name in FACE_DIRECTIONS:
        yield f"Deform.{name}", (T, 1), (M, 3)
    for name in TENSORS:
        yield f"Deform.{name}", (T, 1), (3, 3, M)
        yield f"Deform_ARBM.{name}", (T, 1), (3, 3, M)
    for name, shape in (("Points", (N, 2)), ("CorCoeffVec", (N, 1))):
        yield f"DIC2Dinfo.{name}", (2 * T, 1), shape
    for name in ("nCamRef", "nCamDef", "nImages"):
        yield f"DIC2Dinfo.{name}", None, (1, 1)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("matlab")
    with ResultsFile(write(folder / "r.h5", T)) as results:
        (path,) = export_matlab(results, folder / "mat")
    return path


@pytest.fixture(scope="module")
def content(exported):
    return scipy.io.loadmat(exported)


def at(content, path):
    """A field of DIC3DPPresults as MATLAB's dots and DIC2Dinfo{1} reach it."""
    value = content["DIC3DPPresults"]
    for name in path.split("."):
        value = value[name][0, 0]
        if name == "DIC2Dinfo":
            value = value[0, 0]
    return value


def test_the_file_has_multidics_name_and_its_structure_first(exported, content):
    assert exported.name == "DIC3DPPresults_1Pairs.mat"
    assert [name for name in content if not name.startswith("__")] == ["DIC3DPPresults", "bscd"]
    assert content["DIC3DPPresults"].shape == (1, 1)


@pytest.mark.parametrize(("path", "cells", "shape"), [*multidic_uses()], ids=lambda v: v if isinstance(v, str) else "")
def test_every_field_that_multidic_uses_has_its_shape(content, path, cells, shape):
    value = at(content, path)
    if cells is None:
        assert value.shape == shape
        assert value.dtype.kind in "fu"
        return
    assert value.shape == cells
    assert value.dtype == object
    for cell in value.ravel():
        assert cell.shape == shape
        assert cell.dtype == np.float64


def test_points_displacements_and_matches_are_those_measured(content):
    for k, frame in enumerate(frames(T)):
        np.testing.assert_array_equal(at(content, "Points3D")[k, 0], frame.xyz_mm)
        np.testing.assert_array_equal(at(content, "Disp.DispVec")[0, k], frame.displacement_mm)
        np.testing.assert_allclose(
            at(content, "Disp.DispMgn")[0, k][:, 0], np.linalg.norm(frame.displacement_mm, axis=1)
        )
        np.testing.assert_array_equal(at(content, "DIC2Dinfo.Points")[k, 0], frame.left_px + 1)
        np.testing.assert_array_equal(at(content, "DIC2Dinfo.Points")[T + k, 0], frame.right_px + 1)
        coefficient = 2 * (1 - frame.zncc.astype(np.float64))  # Ncorr's: a smaller one is better
        np.testing.assert_array_equal(at(content, "corrComb")[k, 0][:, 0], coefficient)
        np.testing.assert_array_equal(at(content, "FaceCorrComb")[0, k][:, 0], coefficient[FACES].max(axis=1))


def test_faces_count_from_one_and_are_those_of_the_grid(content):
    np.testing.assert_array_equal(at(content, "Faces"), FACES + 1)


def test_faces_are_measured_against_the_reference_and_not_against_the_first_frame(content):
    reference = reference_mm(grid_px())
    for k, frame in enumerate(frames(T)):
        expected = triangle_deformation(FACES, reference, frame.xyz_mm)
        for name in FACE_MEASURES:
            found = at(content, f"Deform.{name}")[k, 0][:, 0]
            assert np.isnan(found).sum() == np.isnan(frame.xyz_mm[FACES]).any(axis=(1, 2)).sum()
            np.testing.assert_allclose(found, expected[name], atol=1e-9)
            # a rigid motion changes no measure
            np.testing.assert_allclose(at(content, f"Deform_ARBM.{name}")[k, 0][:, 0], expected[name], atol=1e-9)
    known = [np.isfinite(at(content, "Deform.Lamda1")[k, 0]).any() for k in range(T)]
    assert known == [True, True, True, False, True]


def test_tensors_map_a_faces_edges_from_the_reference_as_triSurfaceDeformation_does(content):
    corners = reference_mm(grid_px())[FACES]
    edges = [corners[:, k] - corners[:, 0] for k in (1, 2)]
    for k, frame in enumerate(frames(T)):
        for name, points in (("Deform", frame.xyz_mm), ("Deform_ARBM", at(content, "Points3D_ARBM")[0, k])):
            gradient, lagrange, almansi = (at(content, f"{name}.{each}")[k, 0] for each in ("Fmat", "Emat", "emat"))
            known = np.isfinite(points[FACES]).all(axis=(1, 2))
            assert (np.isfinite(gradient).all(axis=(0, 1)) == known).all()
            for place, edge in enumerate(edges, 1):
                moved = points[FACES[:, place]] - points[FACES[:, 0]]
                np.testing.assert_allclose(np.einsum("ijm,mj->mi", gradient, edge)[known], moved[known], atol=1e-9)
                # a strain is half the change of squared lengths, by the old ones or the new ones
                change = (np.sum(moved**2, axis=1) - np.sum(edge**2, axis=1))[known] / 2
                for strain, along in ((lagrange, edge), (almansi, moved)):
                    np.testing.assert_allclose(
                        np.einsum("mi,ijm,mj->m", along, strain, along)[known], change, atol=1e-9
                    )


def test_tensors_are_left_out_where_they_have_no_room(tmp_path, monkeypatch):
    path = write(tmp_path / "r.h5", T)
    without = 8 * T * (_NUMBERS_PER_POINT * N + _NUMBERS_PER_FACE * M)
    for room, there in ((without, False), (without + 8 * T * _NUMBERS_OF_TENSORS * M, True)):
        monkeypatch.setattr("bscd.results.export.matlab._LARGEST_BYTES", room)
        with ResultsFile(path) as results:
            (made,) = export_matlab(results, tmp_path / str(there))
        fields = scipy.io.loadmat(made)["DIC3DPPresults"]["Deform"][0, 0].dtype.names
        assert [name in fields for name in TENSORS] == [there] * 4
        assert "Lamda1" in fields


def test_without_its_rigid_motion_a_frame_lies_on_the_reference(content):
    reference = reference_mm(grid_px())
    for k, frame in enumerate(frames(T)):
        moved, unmoved = frame.displacement_mm, at(content, "Points3D_ARBM")[0, k] - reference
        np.testing.assert_allclose(at(content, "Disp.DispVec_ARBM")[0, k], unmoved, atol=1e-9)
        rotation, shift = at(content, "RBM.RotMat")[0, k], at(content, "RBM.TransVec")[0, k]
        np.testing.assert_allclose(at(content, "Points3D_ARBM")[0, k], frame.xyz_mm @ rotation.T + shift.T, atol=1e-9)
        if not np.isnan(moved).all():
            assert np.nansum(unmoved**2) <= np.nansum(moved**2) + 1e-12


@pytest.mark.real_data
def test_the_matches_stand_as_in_a_file_of_multidic(content, real_data):
    """Its own second step's results; a MATLAB 7.3 file, in which h5py sees every array transposed."""
    with h5py.File(real_data / "multidic-speckle/DIC2DpairResults_C_201_C_202.mat") as file:
        theirs = file["DIC2DpairResults"]
        points, images = file[theirs["Points"][0, 0]].shape[1], int(theirs["nImages"][0, 0])
        sizes = {images: T, 2 * images: 2 * T, points: N, theirs["Faces"].shape[1]: M}
        for name in set(theirs) - {"ROImask", "ncorrInfo"}:  # Ncorr's own
            ours = at(content, f"DIC2Dinfo.{name}")
            assert ours.shape == tuple(sizes.get(n, n) for n in reversed(theirs[name].shape)), name
            if theirs[name].dtype == object and name != "ImPaths":
                cell = file[theirs[name][0, 0]]
                assert ours[0, 0].shape == tuple(sizes.get(n, n) for n in reversed(cell.shape)), name
        assert theirs["Faces"][:].min() == at(content, "Faces").min() == 1


def test_what_multidic_has_no_place_for_stands_beside(content):
    (measured, head), beside = (list(frames(T)), header()), content["bscd"][0, 0]
    assert beside["run_sha256"].item() == "ab" * 32
    assert beside["calibration_sha256"].item() == "cd" * 32
    assert beside["title"].item() == head.title
    assert json.loads(beside["parameters_json"].item())["subset_px"] == 21
    np.testing.assert_array_equal(beside["points_px"], grid_px() + 1)
    np.testing.assert_array_equal(beside["frame_number"][:, 0], [3, 4, 5, 6, 7])
    np.testing.assert_array_equal(beside["time_s"][:, 0], [frame.time_s for frame in measured])
    np.testing.assert_array_equal(beside["pressure_kpa"][:, 0], [frame.pressure_kpa for frame in measured])
    codes, names = beside["status_codes"].ravel(), beside["status_names"].ravel()
    assert {int(code): name.item() for code, name in zip(codes, names, strict=True)} == head.status_names
    for k, frame in enumerate(measured):
        for name in ("uvw_mm", "strain", "sigma_mm", "displacement_sigma_mm"):
            np.testing.assert_array_equal(beside[name][0, k], getattr(frame, name))
        np.testing.assert_array_equal(beside["status"][0, k][:, 0], frame.status)


def test_extrapolated_points_are_marked(tmp_path):
    measured = [with_extrapolated(frame, 7 + k) for k, frame in enumerate(frames(2))]
    with ResultsFile(write(tmp_path / "r.h5", measured=measured)) as results:
        beside = scipy.io.loadmat(*export_matlab(results, tmp_path))["bscd"][0, 0]
    assert [np.flatnonzero(cell).tolist() for cell in beside["extrapolated"][0]] == [[7], [8]]


def test_points_without_a_surface_are_exported(tmp_path):
    with ResultsFile(write(tmp_path / "r.h5", 2, header(points_px=grid_px(4, 1)))) as results:
        (path,) = export_matlab(results, tmp_path)
    found = scipy.io.loadmat(path)["DIC3DPPresults"]
    assert found["Points3D"][0, 0][1, 0].shape == (4, 3)
    assert found["Faces"][0, 0].size == 0


def test_what_matlab_can_not_read_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr("bscd.results.export.matlab._LARGEST_BYTES", 60_000)
    path = write(tmp_path / "r.h5", T)
    with ResultsFile(path) as results, pytest.raises(InputError, match=r"5 frames of 20 points, 3 are possible"):
        export_matlab(results, tmp_path / "mat")
    assert not (tmp_path / "mat").exists()


def test_the_size_that_is_reckoned_with_is_that_of_the_file(tmp_path):
    points_px = grid_px(12, 12)
    frame = next(frames(1, points_px))
    sizes = []
    for count in (1, 11):
        measured = [replace(frame, number=k) for k in range(count)]
        with ResultsFile(
            write(tmp_path / f"{count}.h5", head=header(points_px=points_px), measured=measured)
        ) as results:
            sizes.append(export_matlab(results, tmp_path / str(count))[0].stat().st_size)
    faces = len(triangulate(points_px))
    reckoned = 8 * (_NUMBERS_PER_POINT * 144 + (_NUMBERS_PER_FACE + _NUMBERS_OF_TENSORS) * faces)
    assert (sizes[1] - sizes[0]) / 10 == pytest.approx(reckoned, rel=0.05)


def test_nothing_is_overwritten(exported):
    before = exported.read_bytes()
    with ResultsFile(exported.parents[1] / "r.h5") as results, pytest.raises(InputError, match="exists already"):
        export_matlab(results, exported.parent)
    assert exported.read_bytes() == before
