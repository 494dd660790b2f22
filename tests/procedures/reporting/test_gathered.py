"""What a report tells of results, against values that were put in or computed another way."""

from types import SimpleNamespace

import numpy as np
import pytest

from bscd.procedures.reporting.inflation import chosen_frames, frame_rate_hz, inflation_data, lost_frames
from bscd.procedures.reporting.sphere import surface_area_mm2
from bscd.procedures.reporting.views import centre_mm, distance_mm, stereo_angle_deg
from tests.procedures.reporting.rest_results import REST_KPA, write_rest


def camera(centre, focal=10_000.0):
    """A camera at a place that looks along y."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    intrinsic = np.array([[focal, 0.0, 640.0], [0.0, focal, 512.0], [0.0, 0.0, 1.0]])
    return intrinsic @ np.column_stack([turn, -turn @ np.asarray(centre)])


class TestViews:
    def test_centre_and_distance(self):
        assert np.allclose(centre_mm(camera([3.0, -622.0, 5.0])), [3.0, -622.0, 5.0])
        assert distance_mm(camera([0.0, -622.0, 0.0]), np.array([0.0, 8.0, 0.0])) == pytest.approx(630.0)

    def test_angle(self):
        pair = camera([0.0, -600.0, 0.0]), camera([600.0 * np.sin(0.3), -600.0 * np.cos(0.3), 0.0])
        assert stereo_angle_deg(pair, np.zeros(3)) == pytest.approx(np.degrees(0.3))


class TestArea:
    def grid(self):
        column, row = np.meshgrid(np.arange(21.0), np.arange(11.0))
        points = 10.0 * np.stack([column.ravel(), row.ravel()], axis=1)
        leaning = np.column_stack([0.05 * points[:, 0], 0.05 * points[:, 0], 0.05 * points[:, 1]])
        return points, leaning

    def test_of_a_leaning_plane(self):
        points, xyz = self.grid()
        assert surface_area_mm2(points, xyz) == pytest.approx(10.0 * np.sqrt(2.0) * 5.0)

    def test_a_hole_does_not_count(self):
        points, xyz = self.grid()
        hole = (np.abs(points - [100.0, 50.0]) < [35.0, 25.0]).all(axis=1)  # 7 x 5 points
        cut = surface_area_mm2(points, np.where(hole[:, None], np.nan, xyz))
        missing = 0.05**2 * np.sqrt(2.0) * (80.0 * 60.0 - 4 * 50.0)  # of a hole's corners half a square is seen
        assert cut == pytest.approx(10.0 * np.sqrt(2.0) * 5.0 - missing)

    def test_of_nothing(self):
        points, xyz = self.grid()
        assert surface_area_mm2(points, np.full_like(xyz, np.nan)) == 0.0


class TestFrames:
    def test_maps_are_at_a_quarter_half_the_papers_13_of_16_and_the_top(self):
        pressure = np.concatenate([np.full(5, 0.05), np.linspace(0.05, 16.0, 320)])
        assert np.allclose(pressure[chosen_frames(pressure)], [4.0, 8.0, 13.0, 16.0], atol=0.03)

    def test_without_pressures_they_are_spaced_evenly(self):
        assert chosen_frames(np.full(101, np.nan)).tolist() == [25, 50, 81, 100]
        assert chosen_frames(np.full(1, np.nan)).tolist() == [0]

    def test_rate_and_lost_frames(self):
        assert frame_rate_hz(np.array([0.0, 0.1, 0.2, 0.6, 0.7])) == pytest.approx(10.0)
        assert np.isnan(frame_rate_hz(np.full(4, np.nan)))
        rows = np.array([(5,), (6,), (9,), (10,), (12,)], dtype=[("frame_id", "<i8")])
        assert lost_frames(rows) == 3


def test_the_series_and_maps_of_an_inflation(tmp_path):
    pressures = np.array([*[REST_KPA] * 6, 1.0, 2.0, 3.25, 4.0])
    lost = {"status": lambda values: np.where(np.arange(1600) % 40 == 0, 4, values["status"]).astype(np.uint8)}
    with write_rest(tmp_path / "results.h5", pressures, 4, **lost) as results:
        rows = np.array([(k + (k > 7),) for k in range(10)], dtype=[("frame_id", "<i8")])
        data = inflation_data(SimpleNamespace(results=results, rows=lambda: rows))
    assert np.allclose(data.series.w_apex_mm, pressures - REST_KPA, atol=0.03)
    assert np.allclose(data.series.w_max_mm, pressures - REST_KPA, atol=0.05)
    assert np.allclose(data.series.e1_max, 0.01 * pressures, rtol=1e-2)
    assert (data.series.valid == 1560).all()
    assert data.counts == {"valid": 1560, "extrapolated": 40}  # they have a position
    assert [one.pressure_kpa for one in data.maps] == [1.0, 2.0, 3.25, 4.0]
    assert data.shown.pressure_kpa == 4.0
    assert data.frames_lost == 1
    assert data.frames_per_s == pytest.approx(11.0)
    # x' and y' of the reference, whatever the membrane has done since
    assert np.allclose(data.places_mm[[0, -1]], [[-9.75, 9.75], [9.75, -9.75]], atol=0.02)
