"""The spline's prefilter and what noise does in it: against the definition, SciPy, chance and a sine's exact spline."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from bscd.dic.spline import noise_energy, prefilter, spline_coefficients, taps
from tests.dic.plain_spline import ORDERS, bspline, coefficients, slopes, value
from tests.dic.speckle_pairs import Speckle, digitise

SPLINES = sorted(ORDERS)
SIZE = (90, 70)

#: What the cut-off prefilter may change in an 8-bit image, grey levels; and in the hardest of all, of a range.
FIR_GREY = 0.0015
FIR_SHARE = 1e-5


@pytest.fixture(scope="module")
def places():
    """Columns and rows all over an image of SIZE."""
    rng = np.random.default_rng(3)
    return rng.uniform(0, SIZE[0] - 1, 4000), rng.uniform(0, SIZE[1] - 1, 4000)


def images():
    rng = np.random.default_rng(5)
    speckle = digitise(Speckle(seed=6, size_px=SIZE).image(), 2.0, rng)
    steps = np.where(np.add.outer(np.arange(SIZE[1]) // 7, np.arange(SIZE[0]) // 9) % 2, 255, 0).astype(np.uint8)
    return {"speckles": speckle, "steps": steps, "noise": rng.integers(0, 256, speckle.shape, dtype=np.uint8)}


def inner(padded, pad):
    return padded[pad:-pad, pad:-pad].astype(float)


def scipys(image, order, x, y):
    """SciPy's spline, which mirrors the image; point reflections of it are put around the image first."""
    room = 60
    extended = np.pad(np.asarray(image, float), room, mode="reflect", reflect_type="odd")
    return ndimage.map_coordinates(extended, [y + room, x + room], order=order, mode="mirror")


@pytest.mark.parametrize("spline", SPLINES)
@pytest.mark.parametrize("name", images())
def test_the_plain_definition_is_scipys(spline, name, places):
    image, order = images()[name].astype(float), ORDERS[spline]
    np.testing.assert_allclose(
        value(coefficients(image, order), order, *places), scipys(image, order, *places), atol=1e-9
    )


@pytest.mark.parametrize("spline", SPLINES)
def test_the_plain_slopes_are_those_of_the_plain_values(spline, places):
    image, order, step = images()["speckles"].astype(float), ORDERS[spline], 1e-5
    filtered = coefficients(image, order)
    # cubics bend at whole pixels, where a difference over a step that crosses one is not the slope
    x, y = (np.where(np.abs(place - np.rint(place)) < 2 * step, place + 4 * step, place) for place in places)
    along, down = slopes(filtered, order, x, y)
    for slope, dx, dy in ((along, step, 0.0), (down, 0.0, step)):
        rise = value(filtered, order, x + dx, y + dy) - value(filtered, order, x - dx, y - dy)
        np.testing.assert_allclose(slope, rise / (2 * step), atol=1e-5)


@pytest.mark.parametrize("spline", SPLINES)
@pytest.mark.parametrize("name", images())
def test_interpolated_grey_levels_are_those_of_the_whole_filter(spline, name, places):
    image, order = images()[name], ORDERS[spline]
    x, y = places
    filtered = inner(spline_coefficients(image, spline, 30), 30)
    wanted = scipys(image, order, x, y)
    limit = 255 * FIR_SHARE if name == "steps" else FIR_GREY
    assert np.abs(value(filtered, order, x, y) - wanted).max() < limit


@pytest.mark.parametrize("spline", SPLINES)
def test_pixels_keep_their_grey_levels_to_the_border(spline):
    image = images()["noise"]
    rows, columns = np.indices(image.shape)
    filtered = inner(spline_coefficients(image, spline, 8), 8)
    back = value(filtered, ORDERS[spline], columns, rows).reshape(image.shape)
    assert np.abs(back - image).max() < FIR_GREY


@pytest.mark.parametrize("spline", SPLINES)
@pytest.mark.parametrize("size", [(5, 5), (6, 9), (31, 80), (33, 40), (70, 90)])
def test_beyond_the_border_coefficients_are_reflected_in_it(spline, size):
    image = np.random.default_rng(1).integers(0, 256, size, dtype=np.uint8)
    padded = spline_coefficients(image, spline, 34)
    assert padded.dtype == np.float32
    assert padded.flags.c_contiguous
    on = padded[34:-34, 34:-34]
    reflected = np.pad(on, 34, mode="reflect", reflect_type="odd")
    np.testing.assert_allclose(padded, reflected, atol=FIR_SHARE * np.ptp(reflected))
    wanted = coefficients(image.astype(float), ORDERS[spline])
    np.testing.assert_allclose(on, wanted, atol=FIR_SHARE * np.ptp(wanted))


@pytest.mark.parametrize("spline", SPLINES)
def test_the_prefilter_is_the_inverse_of_the_sampled_spline(spline):
    kernel, order = prefilter(spline).astype(float), ORDERS[spline]
    assert kernel.sum() == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(kernel, kernel[::-1])
    there_and_back = np.convolve(kernel, bspline(order, np.arange(-3.0, 4.0)))
    there_and_back[len(there_and_back) // 2] -= 1.0
    assert np.abs(there_and_back).sum() < FIR_SHARE  # so no row of pixels can be changed by more
    assert taps(spline) == order + 1


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("spline", SPLINES)
def test_all_types_of_pixels_are_filtered_alike(spline, dtype):
    image = images()["speckles"]
    wanted = coefficients(image.astype(float), ORDERS[spline])
    np.testing.assert_allclose(inner(spline_coefficients(image.astype(dtype), spline, 9), 9), wanted, atol=0.003)


#: How far the stated cosine may be off between whole and half pixels, values and derivatives.
COSINE = {"quintic": (0.001, 0.006), "cubic": (0.01, 0.06)}


@pytest.mark.parametrize("spline", SPLINES)
@pytest.mark.parametrize("across, down", [(0.0, 0.0), (0.5, 0.0), (0.25, 0.5), (0.4, 0.15)])
def test_noise_passes_the_spline_as_stated(spline, across, down):
    order, energy, side, step = ORDERS[spline], noise_energy(spline), 500, 1e-3
    white = np.random.default_rng(8).normal(0.0, 1.0, (side, side))
    filtered = ndimage.spline_filter(white, order, mode="mirror")
    rows, columns = np.mgrid[10 : side - 10, 10 : side - 10] + np.array([down, across])[:, None, None]

    def at(dx):
        places = [rows, columns + dx]
        return ndimage.map_coordinates(filtered, places, order=order, mode="mirror", prefilter=False)

    def stated(terms, fraction):
        return terms[0] + terms[1] * np.cos(2 * np.pi * fraction)

    values, derivatives = np.var(at(0.0)), np.var((at(step) - at(-step)) / (2 * step))
    exact = across in (0.0, 0.5) and down in (0.0, 0.5)
    # variances from 230 000 samples, of which neighbours are correlated, are known to about 0.4 %
    off = 0.01 + (0.0 if exact else np.array(COSINE[spline]))
    wanted = np.array([stated(energy.value, across), stated(energy.derivative, across)]) * stated(energy.value, down)
    assert np.all(np.abs([values, derivatives] / wanted - 1.0) < off)


def exact_gain(order, omega, places):
    """What the spline through the samples of ``exp(i omega x)`` is at places (N,), over ``exp(i omega x)``.

    Sampling repeats the spectrum; the B-spline weights the repetitions by ``sinc^(n+1)`` (Poisson's sum formula).
    """
    turns = np.arange(-2000, 2001)
    weight = np.sinc(omega / (2 * np.pi) + turns) ** (order + 1)
    return np.exp(2j * np.pi * np.outer(places, turns)) @ weight / weight.sum()


#: How far the spline through a sine's samples may be from the sine, share of the amplitude.
SINE = {
    ("cubic", 3.0): 0.12,
    ("cubic", 5.0): 0.01,
    ("cubic", 9.0): 8e-4,
    ("quintic", 3.0): 0.04,
    ("quintic", 9.0): 4e-5,
}


@pytest.mark.parametrize("spline, period_px", SINE)
def test_a_sine_is_interpolated_as_far_as_any_spline_can(spline, period_px):
    order, omega, size = ORDERS[spline], 2 * np.pi / period_px, 90
    image = np.tile(127.0 + 100.0 * np.sin(omega * np.arange(size)), (20, 1)).astype(np.float32)
    x = np.random.default_rng(2).uniform(35.0, size - 36.0, 500)  # where the border has died away
    found = value(inner(spline_coefficients(image, spline, 9), 9), order, x, np.full(500, 9.3))
    turned = exact_gain(order, omega, x) * np.exp(1j * omega * x)
    np.testing.assert_allclose(found, 127.0 + 100.0 * turned.imag, atol=FIR_GREY)
    assert np.abs(found - 127.0 - 100.0 * np.sin(omega * x)).max() < 100.0 * SINE[spline, period_px]


@pytest.mark.parametrize("spline", SPLINES)
def test_a_slope_goes_on_to_the_border(spline):
    rows, columns = np.indices((40, 50))
    plane = (3.0 * columns - 2.0 * rows + 100.0).astype(np.float32)
    filtered = inner(spline_coefficients(plane, spline, 8), 8)
    x, y = np.array([0.0, 0.3, 49.0, 48.6, 20.0]), np.array([0.0, 39.0, 0.4, 38.8, 0.1])
    along, down = slopes(filtered, ORDERS[spline], x, y)
    np.testing.assert_allclose(along, 3.0, atol=3e-4)
    np.testing.assert_allclose(down, -2.0, atol=3e-4)


@pytest.mark.parametrize("spline", ["quintic", "cubic"])
@pytest.mark.parametrize("used", [(0, 90), (100, 200), (150, 260)], ids=["left", "middle", "right"])
def test_some_columns_are_filtered_as_in_the_whole_image(spline, used):
    image = np.random.default_rng(1).integers(0, 256, (120, 260)).astype(np.float32)
    columns = np.isin(np.arange(260), np.arange(*used))
    pad = 20
    part = spline_coefficients(image, spline, pad, columns)
    whole = spline_coefficients(image, spline, pad)
    assert part.shape == whole.shape
    reached = slice(used[0] + pad - 3, used[1] + pad + 3)  # what values in these columns rest on
    np.testing.assert_allclose(part[:, reached], whole[:, reached], atol=2e-3)
    far = np.ones(part.shape[1], bool)
    far[max(used[0] - 66, 0) : used[1] + 66 + 2 * pad] = False
    assert (part[:, far] == 0.0).all()
