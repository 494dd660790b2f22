"""The halves of a biprism's image as views."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic import correlate
from bscd.procedures.measuring.views import SIDES, BiprismSplitter, ViewSource
from tests.procedures.measuring.twin_runs import REST_KPA


@pytest.fixture(scope="module")
def image(twin_runs):
    return twin_runs.image(twin_runs.inflated(REST_KPA))


@pytest.fixture(scope="module")
def splitter(image):
    return BiprismSplitter(640.0, image.shape, 21)


@pytest.mark.parametrize("glaring", [False, True])
@pytest.mark.parametrize("side", SIDES)
def test_one_is_as_both_have_it(image, splitter, side, glaring):
    if glaring:
        image = image.copy()
        image[400:500, 200:300] = 255
    source = ViewSource(splitter, 21)
    alone, beside = source.view(side, (image,)), getattr(source.views((image,)), side)
    np.testing.assert_array_equal(alone.coefficients, beside.coefficients)
    np.testing.assert_array_equal(alone.mask, beside.mask)
    assert alone.grey.dtype == np.float32
    np.testing.assert_array_equal(alone.grey, image)
    assert not alone.mask[:, 700:].any() if side == "left" else not alone.mask[:, :600].any()


def test_what_lies_in_the_other_half_is_nothing_to_it(image, splitter):
    other = image.copy()
    other[:, 645:] = 0
    source = ViewSource(splitter, 21)
    column, row = np.meshgrid(np.arange(250.0, 620.0, 30.0), np.arange(300.0, 700.0, 30.0))
    points = np.column_stack([column.ravel(), row.ravel()])
    first = source.view("left", (image,))
    whole, half = (
        correlate(first, source.view("left", (one,)), points, guess_px=np.zeros_like(points), noise_grey=2.0)
        for one in (image, other)
    )
    assert half.valid.sum() > 100
    np.testing.assert_array_equal(whole.displacement_px, half.displacement_px)
