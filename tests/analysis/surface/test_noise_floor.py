"""Noise floors of synthetic static frames whose noise, bias and drift are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bscd.analysis.surface import noise_floor
from bscd.errors import InputError

STD = np.array([0.0006, 0.0006, 0.008])


def static_field(frames=12, points=800, missing=0.0, seed=1):
    """A field = pattern + drift + noise, and its drift; ``missing`` of the values are NaN."""
    rng = np.random.default_rng(seed)
    pattern = np.array([0.001, -0.002, 0.02]) + 3.0 * STD * rng.normal(size=(points, 3))
    drift = rng.normal(size=(frames, 3)) * 5.0 * STD
    field = pattern + drift[:, None] + STD * rng.normal(size=(frames, points, 3))
    field[rng.random(field.shape) < missing] = np.nan
    return field, drift - drift.mean(axis=0)


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_noise_bias_and_drift_are_told_apart(missing):
    field, drift = static_field(missing=missing)
    found = noise_floor(field)
    np.testing.assert_allclose(found.std, STD, rtol=0.03)
    np.testing.assert_allclose(found.drift, drift, atol=5.0 * STD.max() / np.sqrt(800 * (1.0 - missing)))
    np.testing.assert_allclose(found.drift.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(found.bias, np.nanmean(field, axis=(0, 1)), rtol=1e-12)
    np.testing.assert_allclose(found.spatial_std, np.sqrt(10.0) * STD, rtol=0.1)  # the pattern's 3 and the noise's 1
    assert np.median(found.point_std / STD) == pytest.approx(1.0, abs=0.1)
    assert (found.frames, found.points) == (12, 800)


def test_missing_values_are_left_out_of_least_squares():
    """The same residuals as of an explicit regression on points and frames."""
    field, _ = static_field(frames=5, points=9, missing=0.3)
    values = field[..., :1]
    time, point = (axis[np.isfinite(values[..., 0])] for axis in np.meshgrid(range(5), range(9), indexing="ij"))
    design = np.hstack([np.eye(9)[point], np.eye(5)[time]])
    known = values[np.isfinite(values)]
    residual = known - design @ np.linalg.lstsq(design, known, rcond=None)[0]
    expected = np.sqrt(np.sum(residual**2) / (len(known) - np.linalg.matrix_rank(design)))
    assert noise_floor(values).std[0] == pytest.approx(expected, rel=1e-9)


def test_the_estimate_of_few_frames_is_unbiased():
    variance = [noise_floor(static_field(2, 20, seed=k)[0]).std ** 2 / STD**2 for k in range(400)]
    np.testing.assert_allclose(np.mean(variance, axis=0), 1.0, atol=0.06)


def test_points_and_frames_without_a_value_do_not_count():
    field, _ = static_field()
    padded = np.full((14, 900, 3), np.nan)
    padded[1:13, 50:850] = field
    one, two = noise_floor(field), noise_floor(padded)
    np.testing.assert_allclose(two.std, one.std, rtol=1e-9)
    assert (two.frames, two.points) == (12, 800)
    assert np.isnan(two.drift[[0, 13]]).all()
    assert np.isnan(two.point_std[:50]).all()


@settings(max_examples=20, deadline=None)
@given(st.floats(0.1, 100.0), st.tuples(*[st.floats(-10.0, 10.0)] * 3))
def test_the_floor_scales_with_the_field_and_not_with_its_bias(size, shift):
    field, _ = static_field(frames=4, points=30, missing=0.1)
    first, then = noise_floor(field), noise_floor(size * field + shift)
    np.testing.assert_allclose(then.std, size * first.std, rtol=1e-6)
    np.testing.assert_allclose(then.bias, size * first.bias + shift, atol=1e-9)


@pytest.mark.parametrize(
    ("field", "says"),
    [
        (np.zeros((4, 5)), "\\(T, N, C\\)"),
        (np.zeros((1, 5, 3)), "two frames and two points"),
        (np.full((4, 5, 3), np.nan), "0 and 0 have values"),
        (np.zeros((4, 1, 3)), "4 and 1 have values"),
    ],
)
def test_too_little_is_refused(field, says):
    with pytest.raises(InputError, match=says):
        noise_floor(field)
