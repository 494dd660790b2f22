"""Points followed through sequences whose motion is known in closed form."""

import gc
import weakref
from functools import cache

import numpy as np
import pytest

from bscd.dic import prepare
from bscd.dic.tracking import Tracker, TrackingSettings
from tests.dic.motions import bend, rotation, stretch, translation
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (260, 220)
NOISE = 2.0
SPECKLE = Speckle(seed=5, size_px=SIZE)
POINTS = np.stack(np.meshgrid(np.arange(60.0, 201.0, 10.0), np.arange(50.0, 171.0, 10.0)), axis=-1).reshape(-1, 2)
STILL = translation(0.0, 0.0)
COVERED = (slice(80, 150), slice(90, 170))


def frame(motion=STILL, number=0, speckle=SPECKLE, covered=None):
    grey = speckle.image(motion)
    if covered is not None:
        grey[covered] = 120.0
    return prepare(digitise(grey, NOISE, np.random.default_rng([7, number])))


def tracker(**settings):
    return Tracker(frame(), POINTS, TrackingSettings(noise_grey=NOISE, **settings))


def error_px(found, motion):
    return found.position_px - POINTS - motion.displacement_px(POINTS)


def within_sigma(found, motion):
    sigma = np.sqrt(np.diagonal(found.covariance_px2, axis1=1, axis2=2))
    return float(np.mean(np.abs(error_px(found, motion))[found.valid] < sigma[found.valid]))


@cache
def followed_stretch(lost_share):
    points = tracker(lost_share=lost_share)
    motions = [stretch(strain, SIZE) for strain in (0.04, 0.08, 0.12, 0.16, 0.20)]
    return lost_share, [(motion, points.track(frame(motion, number + 1))) for number, motion in enumerate(motions)]


class TestLargeStretch:
    @pytest.fixture(params=[0.02, -1.0], ids=["as it comes", "renewed at every frame"])
    def followed(self, request):
        return followed_stretch(request.param)

    def test_every_point_is_kept_within_its_sigma(self, followed):
        for motion, found in followed[1]:
            assert found.valid.all()
            assert np.sqrt(np.mean(error_px(found, motion) ** 2)) < 0.03
            assert 0.61 < within_sigma(found, motion) < 0.75

    def test_the_gradient_is_that_since_the_first_reference(self, followed):
        for motion, found in followed[1]:
            exact = np.array(motion.matrix) - np.eye(2)
            assert np.abs(np.median(found.gradient, axis=0) - exact).max() < 2e-3

    def test_a_renewed_reference_adds_to_the_uncertainty(self, followed):
        share, results = followed
        sigma = [float(np.median(np.sqrt(found.covariance_px2[:, 0, 0]))) for _, found in results]
        if share < 0.0:
            assert [found.renewals for _, found in results] == [0, 1, 2, 3, 4]
            # each leg begins with another subset than the one that led there: 4 % of it are new each time
            assert (np.diff(sigma) > 0.0).all()
            assert 1.1 * sigma[0] < sigma[-1] < 1.5 * sigma[0]
        else:
            assert results[-1][1].renewals == 0
            assert sigma[-1] < 1.3 * sigma[0]


def test_a_covariance_is_carried_through_the_deformation_since():
    found = tracker(lost_share=-1.0)  # renewed at every frame
    first = found.track(frame(STILL, 1))
    turned = rotation(8.0, SIZE)
    second = found.track(frame(turned, 2))
    assert second.renewals == 1
    # the noise of the frame between draws the points aside and back again: as sure as one match from first to last
    direct = tracker().track(frame(turned, 2))
    ratio = np.linalg.solve(direct.covariance_px2, second.covariance_px2)
    np.testing.assert_allclose(np.median(ratio, axis=0), np.eye(2), atol=0.05)
    # the first reference's part turns with the surface
    matrix = np.array(turned.matrix)
    np.testing.assert_allclose(second.reference_px2, matrix @ first.reference_px2 @ matrix.T, rtol=0, atol=1e-6)
    assert np.median(first.reference_px2 / first.covariance_px2) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("jump", [(40.0, 0.0), (-28.0, 28.0)])
def test_a_jump_of_the_whole_object_keeps_the_field(jump):
    points = tracker()
    before = translation(2.0, 1.0)
    after = translation(2.0 + jump[0], 1.0 + jump[1])
    points.track(frame(before, 1))
    for number in (2, 3):
        found = points.track(frame(after, number))
        assert found.valid.mean() > 0.99
        assert np.abs(error_px(found, after)[found.valid]).max() < 0.08
    assert found.renewals == 0


def test_points_that_were_covered_come_back():
    points = tracker()
    under = ((POINTS > [90, 80]) & (POINTS < [169, 149])).all(axis=1)
    for number in (1, 2, 3):
        motion = translation(0.7 * number, 0.0)
        found = points.track(frame(motion, number, covered=COVERED))
        assert not found.valid[under & ((POINTS > [104, 94]) & (POINTS < [152, 135])).all(axis=1)].any()
        assert np.isnan(found.position_px[~found.valid]).all()
        clear = ((POINTS < [76, 66]) | (POINTS > [181, 161])).any(axis=1)
        assert found.valid[clear].all()
    for number in (4, 5):
        motion = translation(0.7 * number, 0.0)
        found = points.track(frame(motion, number))
    assert found.valid.mean() > 0.99
    error = np.abs(error_px(found, motion)).max(axis=1)
    assert error[clear].max() < 0.08
    # only subsets that the cover's edge crosses while the reference is renewed keep what it drew them aside
    inner = ((POINTS > [105, 95]) & (POINTS < [154, 134])).all(axis=1)
    assert found.valid[inner].all()
    assert error[inner].max() < 0.08


def test_points_that_left_the_image_come_back():
    points = tracker()
    shifts = [20.0, 40.0, 60.0, 80.0, 80.0, 60.0, 40.0, 20.0, 0.0]
    for number, shift in enumerate(shifts):
        motion = translation(shift, 0.0)
        found = points.track(frame(motion, number + 1))
        outside = POINTS[:, 0] + shift > SIZE[0]
        assert not found.valid[outside].any()
        assert np.abs(error_px(found, motion)[found.valid]).max() < 0.1
        assert found.valid[POINTS[:, 0] + shift < SIZE[0] - 12].mean() > 0.95
    assert found.valid.mean() > 0.99


@pytest.mark.parametrize("other", ["another surface", "nothing"])
def test_an_unrelated_frame_gives_nothing_and_the_next_recovers(other):
    points = tracker()
    points.track(frame(translation(1.0, 0.0), 1))
    strange = frame(number=2, speckle=Speckle(seed=50, size_px=SIZE))
    if other == "nothing":
        strange = prepare(digitise(np.full(SIZE[::-1], 90.0), NOISE, np.random.default_rng(1)))
    lost = points.track(strange)
    assert not lost.valid.any()
    assert np.isnan(lost.position_px).all()
    assert np.isnan(lost.covariance_px2).all()
    motion = translation(3.0, -1.0)
    found = points.track(frame(motion, 3))
    assert found.valid.all()
    assert within_sigma(found, motion) > 0.58


def test_motion_goes_on_behind_unrelated_frames():
    points = tracker()
    strange = frame(number=9, speckle=Speckle(seed=50, size_px=SIZE))
    points.track(frame(translation(5.0, 0.0), 1))
    for _ in range(3):
        assert not points.track(strange).valid.any()
    motion = translation(30.0, 6.0)
    found = points.track(frame(motion, 2))
    assert found.valid.mean() > 0.99
    assert np.abs(error_px(found, motion)[found.valid]).max() < 0.08


def test_the_second_order_follows_as_well():
    points = tracker(shape="quadratic")
    for number, strain in enumerate((0.05, 0.1)):
        motion = stretch(strain, SIZE)
        found = points.track(frame(motion, number + 1))
        assert found.valid.all()
        assert 0.58 < within_sigma(found, motion) < 0.80


def test_no_points():
    none = Tracker(frame(), np.zeros((0, 2)), TrackingSettings(noise_grey=NOISE))
    assert none.track(frame(STILL, 1)).valid.shape == (0,)


def test_references_that_no_point_has_are_let_go_but_the_first():
    first, second = frame(), frame(translation(0.5, 0.0), 1)
    kept = weakref.ref(first), weakref.ref(second)
    points = Tracker(first, POINTS, TrackingSettings(noise_grey=NOISE, lost_share=-1.0))
    points.track(second)
    del first, second
    for number in (2, 3):
        points.track(frame(translation(0.5 * number, 0.0), number))
        gc.collect()
    assert kept[1]() is None
    assert kept[0]() is not None  # whatever becomes of the others, every point was seen there


@cache
def followed_bend(shape):
    """A field of second order that grows from frame to frame; motions and what was found."""
    points = tracker(shape=shape)
    motions = [bend(size, SIZE) for size in (2e-4, 4e-4, 6e-4)]
    return [(motion, points.track(frame(motion, number + 1))) for number, motion in enumerate(motions)]


class TestSecondDerivatives:
    def test_curved_is_unbiased_where_affine_is_not(self):
        for (motion, affine), (_, curved) in zip(followed_bend("affine"), followed_bend("curved"), strict=True):
            assert curved.valid.all()
            # the means of this many points have a sigma of 0.0006 px
            assert np.abs(error_px(curved, motion).mean(axis=0)).max() < 0.0025
            # what first order misses is the mean square of the subset's pixels times half the second derivative
            missed = (affine.position_px - curved.position_px).mean(axis=0)[0]
            assert missed == pytest.approx(motion.second_per_px / 2.0 * (21**2 - 1) / 12.0, rel=0.15)

    def test_curved_is_twice_as_sure_as_second_order(self):
        motion, curved = followed_bend("curved")[-1]
        _, quadratic = followed_bend("quadratic")[-1]
        rms = [np.sqrt(np.mean(error_px(found, motion) ** 2)) for found in (curved, quadratic)]
        assert rms[0] < 0.65 * rms[1]
        assert np.median(curved.covariance_px2[:, 0, 0]) < 0.5 * np.median(quadratic.covariance_px2[:, 0, 0])
        assert 0.61 < within_sigma(curved, motion) < 0.75


def test_light_that_turns_away_does_not_pull_the_points_along():
    column, row = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    shade = 1.0 + 0.004 * (column - SIZE[0] / 2.0) - 0.003 * (row - SIZE[1] / 2.0)
    motion = translation(0.4, -0.3)
    shaded = prepare(digitise(SPECKLE.image(motion) * shade, NOISE, np.random.default_rng(3)))
    found = {lighting: tracker(lighting=lighting).track(shaded) for lighting in ("linear", "uniform")}
    middle = (np.abs(shade[POINTS[:, 1].astype(int), POINTS[:, 0].astype(int)] - 1.0) < 0.25)[:, None]
    rms = {lighting: np.sqrt(np.mean(error_px(one, motion) ** 2, where=middle)) for lighting, one in found.items()}
    assert rms["uniform"] > 1.5 * rms["linear"]
    assert 0.61 < within_sigma(found["linear"], motion) < 0.75
    assert within_sigma(found["uniform"], motion) < 0.55
