"""The kernel of `Tracker`: what a match carries on of the noise and the deformation that its reference came with."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def carry_on(
    rows,
    gradient,
    covariance,
    share,
    alike,
    of_original,
    reached_gradient,
    reached_covariance,
    reached_reference,
    reached_frame,
    out_covariance,
    out_reference,
    out_frame,
    out_gradient,
):
    """Covariances ``(N, 2, 2)`` px2 and gradients ``(N, 2, 2)`` of points, ``rows`` ``(n,)`` of them, into ``out_...``.

    ``gradient`` and ``covariance`` ``(n, 2, 2)`` are of their match, of which the reference's noise is a ``share``.
    ``reached_...`` ``(N, 2, 2)`` is what they had come to in the reference, and ``alike`` ``(N,)`` how much of their
    subset there is what was matched to it; ``of_original`` says that it is the sequence's first reference.
    """
    for n in range(len(rows)):
        row = rows[n]
        a, b = 1.0 + gradient[n, 0, 0], gradient[n, 0, 1]
        c, d = gradient[n, 1, 0], 1.0 + gradient[n, 1, 1]
        for i in range(2):
            p, q = (a, b) if i == 0 else (c, d)
            for j in range(2):
                r, s = (a, b) if j == 0 else (c, d)
                carried = _turned(reached_covariance[row], p, q, r, s)
                drawn = _turned(reached_frame[row], p, q, r, s)
                own = covariance[n, i, j]
                of_reference = own * share
                out_covariance[row, i, j] = own + carried - alike[row] * (drawn + of_reference)
                out_frame[row, i, j] = own - of_reference
                out_reference[row, i, j] = of_reference if of_original else _turned(reached_reference[row], p, q, r, s)
                before = reached_gradient[row]
                one, other = before[0, j] + (1.0 if j == 0 else 0.0), before[1, j] + (1.0 if j == 1 else 0.0)
                out_gradient[row, i, j] = p * one + q * other - (1.0 if i == j else 0.0)


@njit(cache=True, inline="always")
def _turned(part, p, q, r, s):
    """(p, q) part (r, s)^T."""
    return (p * part[0, 0] + q * part[1, 0]) * r + (p * part[0, 1] + q * part[1, 1]) * s
