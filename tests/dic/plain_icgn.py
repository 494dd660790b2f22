"""IC-GN with ZNSSD as the papers have it, a point at a time: it defines what the kernel must compute.

Pan, Li, Tong 2013 (Exp Mech 53:1277-1289) for the affine shape function, Gao et al. 2015 (Opt Lasers Eng 65:73-80) for
the second order. Only usable pixels take part: those whose place lies on the image and whose nearest pixel the mask
allows, in the reference and, in the first iterations, in the current image.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tests.dic.motions import FloatArray
from tests.dic.plain_spline import ORDERS, coefficients, slopes, value

#: Exponents of (dx, dy) and factors of the shape function's terms: 1, dx, dy, dx^2 / 2, dx dy, dy^2 / 2.
TERMS = ((0, 0, 1.0), (1, 0, 1.0), (0, 1, 1.0), (2, 0, 0.5), (1, 1, 1.0), (0, 2, 0.5))

#: Which pixels take part is settled after so many iterations.
SETTLED = 4


@dataclass(frozen=True)
class PlainImage:
    """An image ``(H, W)`` with the coefficients of the spline through it and, where not all counts, its mask."""

    coefficients: FloatArray
    spline: str
    mask: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, grey: NDArray, spline: str = "quintic", mask: NDArray[np.bool_] | None = None) -> PlainImage:
        return cls(coefficients(np.asarray(grey, float), ORDERS[spline]), spline, mask)

    def at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        return value(self.coefficients, ORDERS[self.spline], x, y)

    def slopes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        return slopes(self.coefficients, ORDERS[self.spline], x, y)

    def usable(self, x: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
        height, width = self.coefficients.shape
        on = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
        if self.mask is None:
            return on
        column, row = (np.floor(np.where(on, places, 0.0) + 0.5).astype(int) for places in (x, y))
        return on & self.mask[row, column]


@dataclass(frozen=True)
class PlainMatch:
    """One point's answer; ``status`` is "valid", "outside" or "not converged".

    ``shape`` ``(P,)``, ``covariance`` ``(2, 2)`` of (u, v) for noise of 1 grey level, ``residual_variance`` grey levels
    squared, ``norm_px`` of the last step. The figures belong to the last comparison, before its step is taken.
    """

    status: str
    shape: FloatArray
    zncc: float = np.nan
    gain: float = np.nan
    covariance: FloatArray | None = None
    residual_variance: float = np.nan
    pixels: int = 0
    norm_px: float = np.nan
    iterations: int = 0


def basis(dx: FloatArray, dy: FloatArray, terms: int) -> FloatArray:
    """The shape function's terms ``(N, terms)`` at offsets ``(N,)``."""
    return np.stack([factor * dx**a * dy**b for a, b, factor in TERMS[:terms]], axis=1)


def match(
    reference: PlainImage,
    current: PlainImage,
    point: tuple[float, float],
    guess: FloatArray,
    *,
    subset_px: int = 21,
    tolerance_px: float = 1e-6,
    max_iterations: int = 50,
    fewest: int = 1,
    noise_energy: tuple[float, float] = (0.0, 0.0),
    solved: int | None = None,
    lit: bool = False,
) -> PlainMatch:
    """Match one point from the shape parameters ``(6,)`` or ``(12,)`` of its guess.

    Fewer pixels than ``fewest`` are outside. ``noise_energy`` is what noise adds to the squares of a reference pixel's
    slopes by column and by row. With ``solved`` = 2 only u and v are solved for, with 6 of 12 the affine ones; the rest
    of the guess is held. ``lit``: the light may change linearly across the subset.
    """
    p, half = np.array(guess, float), len(guess) // 2
    radius = subset_px // 2
    dy, dx = (offsets.ravel().astype(float) for offsets in np.mgrid[-radius : radius + 1, -radius : radius + 1])
    allowed = reference.usable(point[0] + dx, point[1] + dy)
    dx, dy = dx[allowed], dy[allowed]
    f_all = reference.at(point[0] + dx, point[1] + dy)
    slope_x, slope_y = reference.slopes(point[0] + dx, point[1] + dy)
    terms = basis(dx, dy, half)
    parts = (len(p) if solved is None else solved) // 2
    free = np.concatenate([np.arange(parts), half + np.arange(parts)])
    held = np.setdiff1d(np.arange(len(p)), free)
    descent_all = np.hstack([slope_x[:, None] * terms[:, :parts], slope_y[:, None] * terms[:, :parts]])
    used = np.ones(len(dx), bool)
    found = PlainMatch("not converged", p)
    for iteration in range(max_iterations):
        x, y = point[0] + dx + terms @ p[:half], point[1] + dy + terms @ p[half:]
        if not current.usable(np.array(point[0] + p[0]), np.array(point[1] + p[half])):
            return PlainMatch("outside", p)
        if iteration < SETTLED:
            used = current.usable(x, y)
        if np.count_nonzero(used) < fewest:
            return PlainMatch("outside", p)
        f, g, descent = f_all[used], current.at(x[used], y[used]), descent_all[used]
        ramps = f[:, None] * np.stack([dx[used], dy[used]], axis=1) if lit else np.zeros((len(f), 0))
        f, g = f - f.mean(), g - g.mean()
        gain = np.linalg.norm(g) / np.linalg.norm(f)
        light = np.hstack([np.ones((len(f), 1)), f[:, None], ramps])
        hessian, off = _hessian(descent, light), descent.T @ (g / gain - f)
        alike = f
        if lit:  # all that light and texture explain is no information on the displacement
            explained = light @ np.linalg.lstsq(light, g, rcond=None)[0]
            off, alike = descent.T @ (g - explained) / gain, explained
        step = np.zeros(len(p))
        step[free] = np.linalg.solve(hessian, off)
        before, p = p, composed(p, inverse_of=step)
        p[held] = before[held]
        zncc = alike @ g / (np.linalg.norm(alike) * np.linalg.norm(g))
        norm = _norm(step, radius)
        found = PlainMatch(
            "valid" if norm < tolerance_px else "not converged",
            p,
            zncc,
            gain,
            _covariance(hessian, terms[used][:, :parts], noise_energy),
            2.0 * (f @ f) * (1.0 - zncc) / max(len(f) - len(free) - light.shape[1], 1),
            len(f),
            norm,
            iteration + 1,
        )
        if found.status == "valid":
            break
    return found


def composed(p: FloatArray, *, inverse_of: FloatArray) -> FloatArray:
    """Shape parameters of ``W(p) o W(d)^-1``; of the second order, terms of higher order are dropped."""
    half = len(p) // 2
    return _parameters(_warp(p) @ np.linalg.inv(_warp(inverse_of)), half)


def _hessian(descent: FloatArray, nuisance: FloatArray) -> FloatArray:
    """Of the displacement with offset, gain and light ``(n, K)`` as unknowns beside it: their part is eliminated.

    ``descent`` ``(n, P)`` are the steepest-descent images.
    """
    explained, *_ = np.linalg.lstsq(nuisance, descent, rcond=None)
    rest = descent - nuisance @ explained
    return rest.T @ rest


def _covariance(hessian: FloatArray, terms: FloatArray, noise_energy: tuple[float, float]) -> FloatArray:
    half = terms.shape[1]
    clean = hessian.copy()
    for side, energy in enumerate(noise_energy):
        some = slice(side * half, (side + 1) * half)
        clean[some, some] -= energy * terms.T @ terms
    return np.linalg.inv(clean)[np.ix_([0, half], [0, half])]


def _norm(step: FloatArray, radius: int) -> float:
    """Of a step, at the subset's edge (Gao et al., eq. 17)."""
    reach = np.array([factor * float(radius) ** (a + b) for a, b, factor in TERMS])
    half = len(step) // 2
    return float(np.linalg.norm(np.concatenate([step[:half], step[half:]]) * np.tile(reach[:half], 2)))


def _warp(p: FloatArray) -> FloatArray:
    """The matrix that takes all monomials of a place to those of the warped place, in the order of TERMS.

    For the affine shape function (1, dx, dy), for the second order (1, dx, dy, dx^2, dx dy, dy^2): Gao et al., eq. 14.
    """
    half = len(p) // 2
    exponents = [(a, b) for a, b, _ in TERMS[:half]]
    polynomials = []
    for side, own in ((0, (1, 0)), (1, (0, 1))):
        polynomial = {(a, b): factor * p[side * half + k] for k, (a, b, factor) in enumerate(TERMS[:half])}
        polynomial[own] += 1.0
        polynomials.append(polynomial)
    rows = []
    for a, b in exponents:
        image = {(0, 0): 1.0}
        for factor in [polynomials[0]] * a + [polynomials[1]] * b:
            image = _product(image, factor)
        rows.append([image.get(exponent, 0.0) for exponent in exponents])
    return np.array(rows)


def _product(one: dict, other: dict) -> dict:
    """Of two polynomials in (dx, dy)."""
    result: dict[tuple[int, int], float] = {}
    for ((a, b), x), ((c, d), y) in product(one.items(), other.items()):
        result[a + c, b + d] = result.get((a + c, b + d), 0.0) + x * y
    return result


def _parameters(warp: FloatArray, half: int) -> FloatArray:
    factors = np.array([factor for _, _, factor in TERMS[:half]])
    along, down = warp[1] / factors, warp[2] / factors
    along[1] -= 1.0
    down[2] -= 1.0
    return np.concatenate([along, down])
