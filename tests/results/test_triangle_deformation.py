"""Against the definitions, worked out triangle by triangle with full 3 x 3 tensors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bscd.results.export.rigid_motion import rigid_motion
from bscd.results.export.triangle_deformation import isotropy_index, triangle_deformation

FACES = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4]])


def definition(reference, deformed):
    """One triangle's values from F = the map of its edges and its unit normal."""

    def frame(corners):
        a, b = corners[1] - corners[0], corners[2] - corners[0]
        n = np.cross(a, b)
        return np.stack([a, b, n / np.linalg.norm(n)], axis=1)

    gradient = frame(deformed) @ np.linalg.inv(frame(reference))
    lagrange = (gradient.T @ gradient - np.eye(3)) / 2
    almansi = (np.eye(3) - np.linalg.inv(gradient @ gradient.T)) / 2
    values = {"J": np.linalg.det(gradient), "d3": frame(deformed)[:, 2]}
    values |= {"Fmat": gradient, "Cmat": gradient.T @ gradient, "Emat": lagrange, "emat": almansi}
    a, b = reference[1] - reference[0], reference[2] - reference[0]
    values["Area"] = np.linalg.norm(np.cross(a, b)) / 2
    for letter, tensor, normal in (("E", lagrange, frame(reference)[:, 2]), ("e", almansi, frame(deformed)[:, 2])):
        strains, vectors = np.linalg.eigh(tensor)
        plane = np.sort(np.argsort(np.abs(vectors.T @ normal))[:2])  # the two that lie in the triangle
        values[f"{letter}pc1"], values[f"{letter}pc2"] = strains[plane]
        values[f"{letter}pc1vec"], values[f"{letter}pc2vec"] = vectors[:, plane].T
        values[f"{letter}mgn"] = np.linalg.norm(tensor)
        deviator = tensor - np.trace(tensor) / 3 * np.eye(3)
        values[f"{letter}eq"] = np.sqrt(2 / 3 * (deviator * deviator).sum())
        values[f"{letter}ShearMax"] = (strains[plane[1]] - strains[plane[0]]) / 2
    for k in (1, 2):
        along = gradient @ values[f"Epc{k}vec"]
        values[f"Lamda{k}"] = np.linalg.norm(along)
        values[f"Epc{k}vecCur"] = along / np.linalg.norm(along)
    return values


@given(seed=st.integers(0, 2**32 - 1))
def test_every_value_is_its_definition(seed):
    rng = np.random.default_rng(seed)
    reference = (
        np.array([[0, 0, 0], [1, 0, 0.1], [0.2, 1, 0], [1.1, 1, 0.2], [0.7, 2, 0]])
        @ Rotation.random(rng=rng).as_matrix()
    )
    deformed = (
        reference @ (np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3))) + rng.normal(size=3) + 0.02 * rng.normal(size=(5, 3))
    )
    found = triangle_deformation(FACES, reference, deformed)
    for face, corners in enumerate(FACES):
        expected = definition(reference[corners], deformed[corners])
        assert set(found) == set(expected)
        for name, value in expected.items():
            got = found[name][face]
            if "vec" in name:  # a direction has no sign
                got = got * np.sign(got @ value)
            np.testing.assert_allclose(got, value, atol=1e-9, err_msg=name)


def test_a_corner_that_is_not_known_leaves_its_triangles_unknown():
    points = np.random.default_rng(0).normal(size=(5, 3))
    lost = points.copy()
    lost[0] = np.nan
    for found in (triangle_deformation(FACES, points, lost), triangle_deformation(FACES, lost, points)):
        for name, values in found.items():
            assert np.isfinite(values[1:]).all(), name
            if name != "d3":
                assert np.isnan(values[0]).all(), name


def test_a_rigid_motion_deforms_nothing():
    points = np.random.default_rng(1).normal(size=(5, 3))
    found = triangle_deformation(
        FACES, points, points @ Rotation.from_euler("xyz", [20, -40, 70], degrees=True).as_matrix()
    )
    for name in ("Lamda1", "Lamda2", "J"):
        np.testing.assert_allclose(found[name], 1.0, atol=1e-12)
    for name in ("Epc1", "Epc2", "epc1", "Emgn", "Eeq", "eShearMax"):
        np.testing.assert_allclose(found[name], 0.0, atol=1e-12)


def test_isotropy_is_one_for_an_equilateral_triangle_and_nought_for_a_line():
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0], [2, 0, 0], [np.nan, 0, 0]])
    found = isotropy_index(np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]), points)
    np.testing.assert_allclose(found, [1.0, 0.0, np.nan], atol=1e-7)


@given(seed=st.integers(0, 2**32 - 1))
def test_isotropy_is_that_of_the_inertia(seed):
    corners = np.random.default_rng(seed).normal(size=(3, 3))
    inertia = np.linalg.eigvalsh(np.cov(corners.T, bias=True))
    found = isotropy_index(np.array([[0, 1, 2]]), corners)
    assert found[0] == pytest.approx(2 * inertia[1] / (inertia[1] + inertia[2]), abs=1e-7)


@given(seed=st.integers(0, 2**32 - 1))
def test_a_rigid_motion_is_found_again_without_the_points_that_are_not_known(seed):
    rng = np.random.default_rng(seed)
    points, turn, shift = rng.normal(size=(8, 3)), Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    onto = points @ turn.T + shift
    points[0], onto[1] = np.nan, np.nan
    motion = rigid_motion(points, onto)
    np.testing.assert_allclose(motion.rotation, turn, atol=1e-9)
    np.testing.assert_allclose(motion.apply(points)[2:], onto[2:], atol=1e-9)


def test_a_motion_is_no_mirror_and_needs_three_points():
    plane = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert np.linalg.det(rigid_motion(plane, plane * [1, -1, 1]).rotation) == pytest.approx(1.0)
    assert np.isnan(rigid_motion(plane[:2], plane[:2]).rotation).all()
