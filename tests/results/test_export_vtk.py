"""ParaView's files as meshio and an XML parser read them; the surface they hold."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import meshio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bscd.errors import InputError
from bscd.results import ResultsFile
from bscd.results.export import export_vtk
from bscd.results.export.surface import triangulate
from bscd.results.export.vtk import frame_mesh
from tests.results.measured import STEP_PX, frames, grid_px, with_extrapolated, write


@pytest.fixture
def exported(tmp_path):
    with ResultsFile(write(tmp_path / "ball.h5", 5)) as results:
        return export_vtk(results, tmp_path / "vtk")


def test_meshio_reads_the_points_that_are_known(exported):
    read_any = 0
    for path, frame in zip(exported, frames(5), strict=False):
        known = ~np.isnan(frame.xyz_mm[:, 0])
        if not known.any():  # meshio can not read a file without points, VTK can
            assert 'NumberOfPoints="0"' in path.read_text()
            continue
        mesh = meshio.read(path)
        np.testing.assert_array_equal(mesh.points, frame.xyz_mm[known])
        data = mesh.point_data
        np.testing.assert_array_equal(data["point"], np.flatnonzero(known))
        for name in ("displacement_mm", "uvw_mm", "sigma_mm", "displacement_sigma_mm", "zncc", "epipolar_px", "status"):
            np.testing.assert_array_equal(data[name], getattr(frame, name)[known])
        for k, name in enumerate(("exx", "eyy", "exy")):
            np.testing.assert_array_equal(data[name], frame.strain[known, k])
        for k, name in enumerate(("e1", "e2")):
            np.testing.assert_array_equal(data[name], frame.principal[known, k])
        np.testing.assert_array_equal(data["e1_direction"], frame.principal_direction[known])
        np.testing.assert_array_equal(data["valid"], (frame.status == 0)[known])
        np.testing.assert_array_equal(np.stack([data["x_px"], data["y_px"]], axis=1), grid_px()[known])
        read_any += 1
    assert read_any == 4


def test_extrapolated_points_are_marked(tmp_path):
    frame = with_extrapolated(next(frames(1)), 7)
    with ResultsFile(write(tmp_path / "r.h5", measured=[frame])) as results:
        data = meshio.read(export_vtk(results, tmp_path / "vtk")[0]).point_data
    assert data["point"][data["extrapolated"] == 1].tolist() == [7]
    assert (data["valid"] + data["extrapolated"] == 1).all()
    assert data["status"][data["point"] == 7].tolist() == [2]


def test_triangles_are_those_of_the_grid_between_known_points(exported):
    frame, mesh = next(frames(5)), meshio.read(exported[0])
    corners = mesh.point_data["point"][mesh.cells_dict["triangle"]]
    known = ~np.isnan(frame.xyz_mm[:, 0])
    expected = [sorted(t) for t in triangulate(grid_px()) if known[t].all()]
    assert sorted(sorted(t) for t in corners.tolist()) == sorted(expected)
    cells = np.concatenate([block.ravel() for block in mesh.cells_dict.values()])
    assert set(cells) == set(range(len(mesh.points)))  # a point without a triangle is a vertex


def test_the_collection_names_every_frame_with_its_time(exported):
    assert exported[-1].name == "ball.pvd"
    root = ET.parse(exported[-1]).getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    sets = root.findall("Collection/DataSet")
    assert [s.get("file") for s in sets] == [path.name for path in exported[:-1]]
    assert [float(s.get("timestep", "")) for s in sets] == [frame.time_s for frame in frames(5)]
    assert all((exported[-1].parent / s.get("file", "")).is_file() for s in sets)


@pytest.mark.parametrize("times", [(0.0, np.nan, 0.2), (0.0, 0.0, 0.0), (0.2, 0.1, 0.0)])
def test_times_that_are_not_known_or_do_not_increase_become_frame_numbers(tmp_path, times):
    measured = [replace(frame, time_s=time) for frame, time in zip(frames(3), times, strict=True)]
    with ResultsFile(write(tmp_path / "r.h5", measured=measured)) as results:
        *_, collection = export_vtk(results, tmp_path / "vtk")
    assert [s.get("timestep") for s in ET.parse(collection).getroot().iter("DataSet")] == ["3", "4", "5"]


@pytest.mark.parametrize("known", [1, 2, 3])
def test_a_frame_with_few_points(known, tmp_path):
    frame = next(frames(1))
    xyz_mm = np.where(np.arange(20)[:, None] < known, 1.0 + np.arange(60).reshape(20, 3), np.nan)
    path = tmp_path / "one.vtu"
    frame_mesh(grid_px(), triangulate(grid_px()), replace(frame, xyz_mm=xyz_mm)).write(path)
    np.testing.assert_array_equal(meshio.read(path).points, xyz_mm[:known])


def test_nothing_is_overwritten(exported, tmp_path):
    for path in exported[:-1]:
        path.unlink()
    with ResultsFile(tmp_path / "ball.h5") as results, pytest.raises(InputError, match=r"ball\.pvd exists already"):
        export_vtk(results, tmp_path / "vtk")


def area_px(points_px, corners):
    a, b = (points_px[corners[:, k]] - points_px[corners[:, 0]] for k in (1, 2))
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2


@given(columns=st.integers(2, 9), rows=st.integers(2, 9))
def test_a_whole_grid_is_covered_once(columns, rows):
    points_px = grid_px(columns, rows)
    areas_px = area_px(points_px, triangulate(points_px))
    assert (areas_px < 0.0).all()  # rows run down: counter-clockwise as the camera sees it
    assert -areas_px.sum() == pytest.approx((columns - 1) * (rows - 1) * STEP_PX**2)


def test_normals_point_at_the_camera(exported):
    mesh = meshio.read(exported[0])
    a, b, c = (mesh.points[mesh.cells_dict["triangle"][:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 1] < 0.0).all()  # the camera looks along y


@given(holes=st.sets(st.integers(0, 79), max_size=60), turn_deg=st.floats(0.0, 90.0))
def test_no_triangle_crosses_a_hole(holes, turn_deg):
    turn = np.deg2rad(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    kept = np.setdiff1d(np.arange(80), list(holes))
    points_px = (grid_px(10, 8) @ rotation.T)[kept]
    corners = triangulate(points_px)
    if len(corners):
        edges_px = np.linalg.norm(points_px[corners] - points_px[np.roll(corners, 1, axis=1)], axis=2)
        assert edges_px.max() < 1.5 * STEP_PX * 1.42  # the median neighbour is the step, or a diagonal in sparse grids
    assert len(np.unique(np.sort(corners, axis=1), axis=0)) == len(corners)


def test_a_hole_stays_open():
    points_px = grid_px(7, 7)
    ring = np.abs(points_px - points_px.mean(axis=0)).max(axis=1) > 1.5 * STEP_PX  # 3 x 3 points are missing
    areas_px = area_px(points_px[ring], triangulate(points_px[ring]))
    assert -areas_px.sum() == pytest.approx((36 - 16 + 4 * 0.5) * STEP_PX**2)  # its corners have three points


@pytest.mark.parametrize("count", [1, 2, 5])
def test_points_on_a_line_have_no_surface(count):
    assert triangulate(grid_px(count, 1)).shape == (0, 3)
