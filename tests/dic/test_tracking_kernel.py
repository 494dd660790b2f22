"""The tracker's kernel against the same in plain matrices."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic.tracking_kernel import carry_on

RNG = np.random.default_rng(3)
POINTS = 40
ROWS = np.sort(RNG.choice(POINTS, 25, replace=False))


def spread(count):
    factor = RNG.normal(size=(count, 2, 2))
    return factor @ np.swapaxes(factor, 1, 2)


@pytest.mark.parametrize("of_original", [True, False])
def test_what_a_match_carries_on(of_original):
    gradient, own, alike = 0.3 * RNG.normal(size=(len(ROWS), 2, 2)), spread(len(ROWS)), RNG.random(POINTS)
    before = 0.3 * RNG.normal(size=(POINTS, 2, 2))
    reached = [spread(POINTS) for _ in range(3)]
    out = [np.full((POINTS, 2, 2), np.nan) for _ in range(4)]
    carry_on(ROWS, gradient, own, 0.4, alike, of_original, before, *reached, *out)
    onward = np.eye(2) + gradient
    carried, reference, drawn = (onward @ part[ROWS] @ np.swapaxes(onward, 1, 2) for part in reached)
    expected = [
        own + carried - alike[ROWS, None, None] * (drawn + 0.4 * own),
        0.4 * own if of_original else reference,
        0.6 * own,
        onward @ (np.eye(2) + before[ROWS]) - np.eye(2),
    ]
    others = np.setdiff1d(np.arange(POINTS), ROWS)
    for found, wanted in zip(out, expected, strict=True):
        np.testing.assert_allclose(found[ROWS], wanted, rtol=1e-12, atol=1e-12)
        assert np.isnan(found[others]).all()
