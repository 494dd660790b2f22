"""Deformation of a triangulated surface, a triangle at a time, in the terms that MultiDIC names.

A triangle deforms homogeneously: F maps its edges and its unit normal to the deformed ones (triangular Cosserat
point elements, Solav et al., Ann Biomed Eng 44, 2016), so everything follows from its two stretches in the plane.
"""

from __future__ import annotations

import numpy as np

from bscd.arrays import FloatArray, IntArray


def triangle_deformation(
    faces: IntArray, reference_mm: FloatArray, deformed_mm: FloatArray, *, tensors: bool = True
) -> dict[str, FloatArray]:
    """Stretches, strains and their directions of each face ``(M, 3)``; NaN where a corner is not known.

    Returns
    -------
    dict
        ``(M,)``: ``Lamda1 <= Lamda2`` principal stretches, ``J`` area ratio, ``Area`` in the reference; principal
        Green-Lagrange (``Epc1 <= Epc2``) and Euler-Almansi strains (``epc1 <= epc2``), their norms ``Emgn``,
        ``emgn``, equivalent strains ``Eeq``, ``eeq`` (von Mises) and largest shears ``EShearMax``, ``eShearMax``.
        ``(M, 3)``: ``d3`` the deformed normal; ``Epc1vec``, ``Epc2vec`` principal directions in the reference,
        ``Epc1vecCur``, ``Epc2vecCur`` the same in the deformed state, where they are also ``epc1vec``, ``epc2vec``.
        ``(M, 3, 3)`` with ``tensors``: ``Fmat``, ``Cmat`` = F^T F, and the strains ``Emat`` = (C - 1) / 2 and
        ``emat`` = (1 - (F F^T)^-1) / 2.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        edges_mm, moved_mm = _edges(faces, reference_mm), _edges(faces, deformed_mm)
        normal, area_mm2 = _normal(edges_mm)
        along = edges_mm[:, 0] / np.linalg.norm(edges_mm[:, 0], axis=1, keepdims=True)
        basis = np.stack([along, np.cross(normal, along)], axis=1)
        to_plane = np.einsum("mei,mbi->meb", edges_mm, basis)
        gradient = np.einsum("mbe,mei->mbi", _inverse(to_plane), moved_mm)  # where the basis vectors go
        stretches, turns = _principal(np.einsum("mbi,mci->mbc", gradient, gradient))
        before = np.einsum("mbk,mbi->mki", turns, basis)
        after = np.einsum("mbk,mbi->mki", turns, gradient) / stretches[:, :, None]
        lagrange, almansi = (stretches**2 - 1.0) / 2.0, (1.0 - stretches**-2) / 2.0
        known = np.all(np.isfinite(stretches), axis=1)
        moved_normal = _normal(moved_mm)[0]
        values = {
            "Lamda1": stretches[:, 0],
            "Lamda2": stretches[:, 1],
            "J": stretches.prod(axis=1),
            "Area": np.where(known, area_mm2, np.nan),
            "d3": moved_normal,
        }
        for letter, strain in (("E", lagrange), ("e", almansi)):
            values[f"{letter}pc1"], values[f"{letter}pc2"] = strain[:, 0], strain[:, 1]
            values[f"{letter}mgn"] = np.linalg.norm(strain, axis=1)
            deviator = (strain**2).sum(axis=1) - strain.sum(axis=1) ** 2 / 3.0
            values[f"{letter}eq"] = np.sqrt(2.0 / 3.0 * deviator)
            values[f"{letter}ShearMax"] = (strain[:, 1] - strain[:, 0]) / 2.0
    for k in (0, 1):
        values[f"Epc{k + 1}vec"] = before[:, k]
        values[f"Epc{k + 1}vecCur"] = values[f"epc{k + 1}vec"] = after[:, k]
    if tensors:
        values["Fmat"] = np.einsum("mbi,mbj->mij", gradient, basis) + moved_normal[:, :, None] * normal[:, None, :]
        values["Emat"] = np.einsum("mk,mki,mkj->mij", lagrange, before, before)
        values["emat"] = np.einsum("mk,mki,mkj->mij", almansi, after, after)
        values["Cmat"] = np.eye(3) + 2.0 * values["Emat"]
    return values


def isotropy_index(faces: IntArray, points_mm: FloatArray) -> FloatArray:
    """How regular each triangle is ``(M,)``: 1 equilateral, 0 a line; NaN where a corner is not known.

    Twice the smaller over the sum of the two moments of inertia of the corners in the triangle's plane.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        corners_mm = points_mm[faces]
        spread_mm = corners_mm - corners_mm.mean(axis=1, keepdims=True)
        total = (spread_mm**2).sum(axis=(1, 2)) / 3.0
        product = 4.0 / 27.0 * _normal(_edges(faces, points_mm))[1] ** 2
        smaller = (total - np.sqrt(np.maximum(total**2 - 4.0 * product, 0.0))) / 2.0
        return 2.0 * smaller / total


def _edges(faces: IntArray, points_mm: FloatArray) -> FloatArray:
    """The edges from the first corner ``(M, 2, 3)``."""
    corners_mm = points_mm[faces]
    return corners_mm[:, 1:] - corners_mm[:, :1]


def _normal(edges_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normals ``(M, 3)`` and areas ``(M,)``."""
    cross = np.cross(edges_mm[:, 0], edges_mm[:, 1])
    twice_mm2 = np.linalg.norm(cross, axis=1)
    return cross / twice_mm2[:, None], twice_mm2 / 2.0


def _inverse(matrices: FloatArray) -> FloatArray:
    """Inverses of 2 x 2 matrices ``(M, 2, 2)``; not finite where there is none."""
    (a, b), (c, d) = matrices[:, 0].T, matrices[:, 1].T
    adjugate = np.stack([np.stack([d, -b], axis=1), np.stack([-c, a], axis=1)], axis=1)
    return adjugate / (a * d - b * c)[:, None, None]


def _principal(metric: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stretches ``(M, 2)``, the smaller first, and their directions as columns ``(M, 2, 2)``; NaN where not known."""
    known = np.all(np.isfinite(metric), axis=(1, 2))
    squares, turns = np.linalg.eigh(np.where(known[:, None, None], metric, np.eye(2)))
    stretches = np.sqrt(np.maximum(squares, 0.0))
    return np.where(known[:, None], stretches, np.nan), np.where(known[:, None, None], turns, np.nan)
