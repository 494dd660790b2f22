"""Shape functions that hold a part of what they are given."""

from __future__ import annotations

import numpy as np

from tests.dic.test_icgn import MIDDLE, Case, each_set, kernel


@each_set
def test_a_translation_holds_the_gradients_that_it_is_given(instructions):
    case, points = Case("turned", "translation"), np.array(MIDDLE)
    solved, affine = (kernel(one, points, instructions) for one in (case, Case("turned", "affine")))
    held = [1, 2, 4, 5]
    np.testing.assert_allclose(solved.shape[:, held], case.guess(points)[:, held], rtol=0, atol=1e-12)
    np.testing.assert_allclose(solved.shape[:, [0, 3]], affine.shape[:, [0, 3]], atol=0.05)
    assert np.all(solved.column("var_u") < affine.column("var_u"))


@each_set
def test_curved_holds_the_second_derivatives_that_it_is_given(instructions):
    case, points = Case("turned", "curved"), np.array(MIDDLE)
    solved, affine = (kernel(one, points, instructions) for one in (case, Case("turned", "affine")))
    held = [3, 4, 5, 9, 10, 11]
    np.testing.assert_array_equal(solved.shape[:, held], case.guess(points)[:, held])
    assert np.all(np.abs(solved.shape[:, [0, 6]] - affine.shape[:, [0, 3]]) > 1e-3)
    np.testing.assert_allclose(solved.column("var_u"), affine.column("var_u"), rtol=1e-6)
