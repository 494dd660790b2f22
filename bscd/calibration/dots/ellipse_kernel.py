"""The kernels of the ellipse fit: one dot's window, its normal equations and their solution."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_PARAMETERS = 10  # centre (2), ellipse (3), width, plane (3), contrast
_ITERATIONS = 20
_CONVERGED = 1e-3  # change of the sum of squares still expected, in units of the noise variance
_EDGE = 3.6  # beyond so many widths from the rim the model is flat
_WIDTH_START, _WIDTH_MIN, _WIDTH_MAX = 0.7, 0.2, 8.0
#: Stated for a grey-weighted centroid: shading alone may move it this much.
CENTROID_SIGMA_PX = 0.1


@njit(cache=True)
def fit_all(image, xy, shape, limits, reach, top, out):
    """Fit every dot; ``out`` ``(N, 13)`` gets what `EllipseFits` names.

    Columns: centre (2), shape (3: 11, 12, 22), sigma, width, ground, contrast, residual, share of the window seen,
    1 if fitted, share saturated. Rows stay NaN where there is nothing to fit.
    """
    for i in range(len(xy)):
        _fit_one(image, xy[i, 0], xy[i, 1], shape[i], limits, reach, top, out[i])


@njit(cache=True)
def _fit_one(image, x0, y0, shape, limits, reach, top, out):
    s11, s12, s22 = shape[0, 0], shape[0, 1], shape[1, 1]
    det = s11 * s22 - s12 * s12
    if not (det > 0.0 and s11 > 0.0 and s22 > 0.0):
        return
    # shape^-1 = L'L with L = [[p, r], [0, s]]
    p = math.sqrt(s22 / det)
    r = -s12 / det / p
    s = math.sqrt(max(s11 / det - r * r, 1e-12))
    half = 0.5 * (s11 + s22)
    minor = math.sqrt(max(half - math.sqrt(max(half * half - det, 0.0)), 0.25))
    edge = min(reach, 1.0 + max(0.5, 3.0 / minor))
    pixels, values, wanted, saturated = _window(image, x0, y0, p, r, s, edge, limits, top)
    count = len(values)
    out[10] = count / max(wanted, 1)
    out[12] = saturated / max(count, 1)
    if count < 2 * _PARAMETERS:
        return
    _centroid(x0, y0, pixels, values, p, r, s, out)
    out[2], out[3], out[4] = s11, s12, s22
    theta = np.zeros(_PARAMETERS)
    theta[2], theta[3], theta[4], theta[5] = p, r, s, _WIDTH_START
    theta[6] = out[7]
    theta[9] = out[8]
    normal = np.zeros((_PARAMETERS, _PARAMETERS))
    right = np.zeros(_PARAMETERS)
    slopes, misses = np.empty((_PARAMETERS, count)), np.empty(count)
    damping = 0.0
    last = 1e300
    kept = theta.copy()
    done = False
    rss = 0.0
    for _ in range(_ITERATIONS):
        rss = _accumulate(pixels, values, theta, slopes, misses, normal, right)
        if not rss < 1e299:
            return
        if rss > last * (1.0 + _CONVERGED):  # less is the step where the rim is cut off
            damping = max(4.0 * damping, 1e-2)
            theta[:] = kept
            rss = _accumulate(pixels, values, theta, slopes, misses, normal, right)
        else:
            damping *= 0.2
        last = rss
        kept[:] = theta
        for k in range(_PARAMETERS):
            normal[k, k] *= 1.0 + damping
        step, ok = _solved(normal, right)
        if not ok:
            return
        gain = 0.0
        for k in range(_PARAMETERS):
            gain += step[k] * right[k]
        theta += step
        theta[5] = min(max(theta[5], _WIDTH_MIN), _WIDTH_MAX)
        if theta[2] <= 0.0 or theta[4] <= 0.0:
            return
        if gain * count < _CONVERGED * rss and damping < 1e-2:
            done = True
            break
    if not done or abs(theta[0]) + abs(theta[1]) > 2.0 * minor or theta[9] <= 0.0:
        return
    spread = math.sqrt(rss / (count - _PARAMETERS))
    inverse_column = np.zeros(_PARAMETERS)
    variance = 0.0
    for k in range(2):
        inverse_column[:] = 0.0
        inverse_column[k] = 1.0
        column, ok = _solved(normal, inverse_column)
        if not ok:
            return
        variance += 0.5 * column[k]
    p, r, s = theta[2], theta[3], theta[4]
    # the lens blurs the lit dot, the model lights the blurred one: that moves the edge by width^2 times the slope
    ground = theta[6] + theta[7] * theta[0] + theta[8] * theta[1]
    out[0] = x0 + theta[0] + theta[5] ** 2 * theta[7] / ground
    out[1] = y0 + theta[1] + theta[5] ** 2 * theta[8] / ground
    # shape = (L'L)^-1
    out[2] = 1.0 / (p * p) + (r / (p * s)) ** 2
    out[3] = -r / (p * s * s)
    out[4] = 1.0 / (s * s)
    out[5] = spread * math.sqrt(variance)
    out[6], out[7], out[8], out[9], out[11] = theta[5], theta[6], theta[9], spread, 1.0


@njit(cache=True)
def _window(image, x0, y0, p, r, s, edge, limits, top):
    """Pixels (x, y about the start; grey) in an ellipse about the dot, inside the view; how many it would have."""
    high = edge / s
    wide = edge * math.sqrt(1.0 / (p * p) + (r / (p * s)) ** 2)
    first_row, last_row = math.ceil(y0 - high), math.floor(y0 + high)
    first, last = math.ceil(x0 - wide), math.floor(x0 + wide)
    size = max((last_row - first_row + 1) * (last - first + 1), 0)
    pixels, values = np.empty((size, 2)), np.empty(size)
    count, wanted, saturated = 0, 0, 0
    for row in range(first_row, last_row + 1):
        y = row - y0
        v = s * y
        for column in range(first, last + 1):
            x = column - x0
            u = p * x + r * y
            if u * u + v * v > edge * edge:
                continue
            wanted += 1
            if row < 0 or row >= image.shape[0] or column < limits[row, 0] or column > limits[row, 1]:
                continue
            pixels[count, 0], pixels[count, 1] = x, y
            values[count] = image[row, column]
            if values[count] >= top:
                saturated += 1
            count += 1
    return pixels[:count], values[:count], wanted, saturated


@njit(cache=True)
def _centroid(x0, y0, pixels, values, p, r, s, out):
    """Grey-weighted centroid below the brightest part of the window; also ground and contrast to start with."""
    inner, inner_count, outer, outer_count = 0.0, 0, 0.0, 0
    for k in range(len(values)):
        u = p * pixels[k, 0] + r * pixels[k, 1]
        v = s * pixels[k, 1]
        q = u * u + v * v
        if q < 0.36:
            inner += values[k]
            inner_count += 1
        elif q > 1.44:
            outer += values[k]
            outer_count += 1
    ground = outer / max(outer_count, 1)
    dark = inner / max(inner_count, 1)
    sum_w, sum_x, sum_y = 0.0, 0.0, 0.0
    for k in range(len(values)):
        u = p * pixels[k, 0] + r * pixels[k, 1]
        v = s * pixels[k, 1]
        w = ground - values[k]
        if u * u + v * v < 2.0 and w > 0.0:
            sum_w += w
            sum_x += w * pixels[k, 0]
            sum_y += w * pixels[k, 1]
    if sum_w > 0.0:
        out[0], out[1] = x0 + sum_x / sum_w, y0 + sum_y / sum_w
    else:
        out[0], out[1] = x0, y0
    out[5], out[6], out[7] = CENTROID_SIGMA_PX, _WIDTH_START, ground
    out[8] = min(max(1.0 - dark / max(ground, 1e-9), 0.02), 1.5)
    out[9], out[11] = np.nan, 0.0


@njit(cache=True, fastmath=True)
def _accumulate(pixels, values, theta, slopes, misses, normal, right):
    """Normal equations of the model at theta; gives the sum of squared residuals.

    ``slopes`` ``(10, N)`` and ``misses`` ``(N,)`` are work space; parameters come first so that sums vectorise.
    """
    p, r, s, width = theta[2], theta[3], theta[4], theta[5]
    c = theta[9]
    count = len(values)
    rss = 0.0
    for k in range(count):
        x, y = pixels[k, 0], pixels[k, 1]
        ground = theta[6] + theta[7] * x + theta[8] * y
        dx, dy = x - theta[0], y - theta[1]
        u, v = p * dx + r * dy, s * dy
        q = math.sqrt(u * u + v * v) + 1e-12
        mx, my = p * u, r * u + s * v  # L'L (x - c)
        length = math.sqrt(mx * mx + my * my) + 1e-12
        z = (1.0 - q) * q / (length * width)
        coverage = 0.0
        if abs(z) < _EDGE:
            coverage = 0.5 + 0.5 * math.erf(z * 0.7071067811865476)
            density = -ground * c * 0.3989422804014327 * math.exp(-0.5 * z * z) / width
            by_q = density * (1.0 - 2.0 * q) / (length * q)
            by_m = -density * (1.0 - q) * q / (length * length * length)
            slopes[0, k] = -by_q * mx - by_m * (mx * p * p + my * r * p)
            slopes[1, k] = -by_q * my - by_m * (mx * p * r + my * (r * r + s * s))
            slopes[2, k] = by_q * u * dx + by_m * (mx * (u + p * dx) + my * r * dx)
            slopes[3, k] = by_q * u * dy + by_m * (mx * p * dy + my * (u + r * dy))
            slopes[4, k] = by_q * v * dy + by_m * my * 2.0 * v
            slopes[5, k] = -density * z
        else:
            coverage = 1.0 if z > 0.0 else 0.0
            for a in range(6):
                slopes[a, k] = 0.0
        light = 1.0 - c * coverage
        miss = values[k] - ground * light
        rss += miss * miss
        misses[k] = miss
        slopes[6, k], slopes[7, k], slopes[8, k], slopes[9, k] = light, light * x, light * y, -ground * coverage
    for a in range(_PARAMETERS):
        total = 0.0
        for k in range(count):
            total += slopes[a, k] * misses[k]
        right[a] = total
        for b in range(a + 1):
            total = 0.0
            for k in range(count):
                total += slopes[a, k] * slopes[b, k]
            normal[a, b] = total
    return rss


@njit(cache=True)
def _solved(normal, right):
    """Cholesky with the lower triangle of the normal matrix, scaled to a unit diagonal."""
    n = len(right)
    scale = np.empty(n)
    for a in range(n):
        if not normal[a, a] > 0.0:
            return right, False
        scale[a] = 1.0 / math.sqrt(normal[a, a])
    lower = np.zeros((n, n))
    for a in range(n):
        for b in range(a + 1):
            total = normal[a, b] * scale[a] * scale[b]
            for k in range(b):
                total -= lower[a, k] * lower[b, k]
            if a == b:
                if total <= 1e-12:
                    return right, False
                lower[a, a] = math.sqrt(total)
            else:
                lower[a, b] = total / lower[b, b]
    x = np.empty(n)
    for a in range(n):
        total = right[a] * scale[a]
        for k in range(a):
            total -= lower[a, k] * x[k]
        x[a] = total / lower[a, a]
    for a in range(n - 1, -1, -1):
        total = x[a]
        for k in range(a + 1, n):
            total -= lower[k, a] * x[k]
        x[a] = total / lower[a, a]
    return x * scale, True
