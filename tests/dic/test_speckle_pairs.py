"""The pairs that everything else is measured on: against the formula, and the motions against their own inverses."""

import numpy as np
import pytest

from tests.dic.motions import Sinusoid, rotation, sinusoid, stretch, translation
from tests.dic.speckle_pairs import Speckle

SIZE = (75, 70)
MOTIONS = {
    "at rest": translation(0.0, 0.0),
    "translation": translation(3.37, -2.61),
    "stretch": stretch(0.02, SIZE),
    "rotation": rotation(3.0, SIZE),
    "sinusoid 256": sinusoid(1.0, 256.0),
    "sinusoid 64": sinusoid(0.5, 64.0),
}


@pytest.fixture(scope="module")
def speckle():
    return Speckle(seed=3, size_px=SIZE)


def formula(speckle, x, y):
    """The plain NumPy image: every spot at every pixel, with the library's exponential."""
    bare = np.ones(x.shape)
    for spot_x, spot_y, radius, height in speckle.spots:
        bare *= 1.0 - height * np.exp(-((x - spot_x) ** 2 + (y - spot_y) ** 2) / radius**2)
    return speckle.dark_grey + (speckle.bright_grey - speckle.dark_grey) * (1.0 - bare)


@pytest.mark.parametrize("name", MOTIONS)
def test_images_are_the_formula_at_the_material_points(speckle, name):
    columns, rows = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    wanted = formula(speckle, *MOTIONS[name].material_px(columns, rows))
    np.testing.assert_allclose(speckle.image(MOTIONS[name]), wanted, atol=1e-7)


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_and_its_inverse_cancel(name):
    points = np.random.default_rng(0).uniform(-50.0, 1300.0, (500, 2))
    moved = points + MOTIONS[name].displacement_px(points)
    back = np.column_stack(MOTIONS[name].material_px(*moved.T))
    np.testing.assert_allclose(back, points, atol=1e-10)


def test_a_rotation_turns_the_columns_axis_towards_the_rows_axis_about_the_centre():
    centre = np.array([[(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2]])
    turned = rotation(90.0, SIZE).displacement_px(centre + [[10.0, 0.0]])
    np.testing.assert_allclose(turned, [[-10.0, 10.0]], atol=1e-12)


def test_a_sinusoid_that_folds_has_no_inverse():
    with pytest.raises(ArithmeticError, match="no inverse"):
        Sinusoid(40.0, 64.0).material_px(np.arange(64.0), np.arange(64.0))


def test_the_gradient_is_that_of_the_formula(speckle):
    columns, rows = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    step = 1e-4
    across = (formula(speckle, columns + step, rows) - formula(speckle, columns - step, rows)) / (2 * step)
    down = (formula(speckle, columns, rows + step) - formula(speckle, columns, rows - step)) / (2 * step)
    np.testing.assert_allclose(speckle.gradient(), [across, down], atol=1e-5)


def test_noise_is_as_asked_and_its_own_in_each_image(speckle):
    reference, current = speckle.pair(translation(0.0, 0.0), noise_grey=2.0, seed=5)
    assert reference.dtype == current.dtype == np.uint8
    inside = (speckle.image() > 40.0) & (speckle.image() < 220.0)
    noise = [(image - speckle.image())[inside] for image in (reference, current)]
    assert np.std(noise, axis=1) == pytest.approx(np.sqrt(2.0**2 + 1 / 12), rel=0.05)
    assert abs(np.corrcoef(noise)[0, 1]) < 0.06
    again = speckle.pair(translation(0.0, 0.0), noise_grey=2.0, seed=5)
    assert all(np.array_equal(a, b) for a, b in zip((reference, current), again, strict=True))


def test_without_noise_only_rounding_is_lost(speckle):
    reference, _ = speckle.pair(MOTIONS["translation"])
    assert np.abs(reference - speckle.image()).max() <= 0.5
