"""The curve of a view's point in the other view, against the projection of points in space."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bscd.calibration import epipolar_curve
from bscd.calibration.epipolar import at_depth
from tests.calibration.test_dlt import image, pinhole

tilts = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
points = st.lists(
    st.tuples(st.floats(-15, 15), st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=5, unique=True
)


@settings(max_examples=50, deadline=None)
@given(tilt=tilts, distance=st.floats(300.0, 1500.0), seen=points)
def test_a_point_is_found_again_at_its_own_depth(tilt, distance, seen):
    camera, xyz = pinhole(tilt, distance), np.array(seen)
    found = at_depth(camera, image(camera, xyz), xyz[:, 1])
    own = np.arange(len(xyz))
    assert found.shape == (len(xyz), len(xyz), 3)
    assert np.abs(found[own, own] - xyz).max() < 1e-7


@settings(max_examples=50, deadline=None)
@given(tilt=tilts, seen=points, depths=st.lists(st.floats(-20, 20), min_size=1, max_size=4))
def test_all_depths_of_a_point_have_one_image(tilt, seen, depths):
    camera = pinhole(tilt, 622.0)
    seen_px = image(camera, np.array(seen))
    along = at_depth(camera, seen_px, np.array(depths))
    assert np.array_equal(along[:, :, 1], np.broadcast_to(depths, along.shape[:2]))
    assert np.abs(image(camera, along.reshape(-1, 3)).reshape(along.shape[:2] + (2,)) - seen_px[:, None]).max() < 1e-6


@settings(max_examples=50, deadline=None)
@given(left=tilts, right=tilts, seen=points)
def test_the_other_camera_sees_it_on_the_curve(left, right, seen):
    first, second, xyz = pinhole(left, 622.0), pinhole(right, 700.0), np.array(seen)
    depths = np.linspace(-25.0, 25.0, 201)
    curve = epipolar_curve(first, second, image(first, xyz), depths)
    for place, at, y in zip(image(second, xyz), curve, xyz[:, 1], strict=True):
        between = [np.interp(y, depths, at[:, axis]) for axis in (0, 1)]
        assert np.abs(between - place).max() < 0.01  # the curve runs on between its depths


def test_an_unknown_image_has_an_unknown_curve_and_leaves_the_others():
    first, second = pinhole((0.0, 0.0, 0.17), 622.0), pinhole((0.0, 0.0, -0.17), 622.0)
    seen = np.array([[600.0, 500.0], [np.nan, 500.0], [700.0, 300.0]])
    curve = epipolar_curve(first, second, seen, np.array([-1.0, 0.0, 1.0]))
    assert np.isnan(curve[1]).all()
    assert np.array_equal(curve[[0, 2]], epipolar_curve(first, second, seen[[0, 2]], np.array([-1.0, 0.0, 1.0])))
