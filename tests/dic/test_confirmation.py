"""Which matches their neighbours confirm: on fields made up for it."""

from __future__ import annotations

import numpy as np
import pytest

from bscd.dic import grid_points
from bscd.dic.confirmation import confirmed

SUBSET = 21
POINTS = grid_points((200, 240), 7)


def field(displacement, gradient=None):
    """Shape parameters ``(N, 6)`` of a displacement ``(N, 2)`` and its gradient ``(N, 2, 2)``."""
    slopes = np.zeros((len(POINTS), 2, 2)) if gradient is None else gradient
    return np.concatenate([displacement[:, :, None], slopes], axis=2).reshape(len(POINTS), 6)


def bent(points):
    """A rotation of 20 degrees on which a parabola bends the columns."""
    offset = points - (120, 100)
    turn = np.array([[np.cos(0.35) - 1, -np.sin(0.35)], [np.sin(0.35), np.cos(0.35) - 1]])
    displacement = offset @ turn.T + np.column_stack([8e-3 * offset[:, 1] ** 2 / 2, np.zeros(len(points))])
    slopes = np.tile(turn, (len(points), 1, 1))
    slopes[:, 0, 1] += 8e-3 * offset[:, 1]
    return displacement, slopes


def ask(index, shape, valid=None, sure=None):
    everyone = np.ones(len(POINTS), bool)
    valid = everyone if valid is None else valid
    sure = np.zeros(len(POINTS), bool) if sure is None else sure
    return confirmed(index, POINTS, shape, valid, sure, np.full(len(POINTS), 0.9), SUBSET)


def near(place, radius):
    return np.flatnonzero(np.abs(POINTS - place).max(axis=1) < radius)


def test_a_smooth_field_confirms_all_of_itself_to_its_corners():
    everyone = np.arange(len(POINTS))
    assert ask(everyone, field(*bent(POINTS))).all()


@pytest.mark.parametrize("sure", [True, False])
@pytest.mark.parametrize("radius", [4, 8, 12])
def test_a_cluster_of_chance_is_alone(radius, sure):
    displacement, slopes = bent(POINTS)
    cluster = near((100, 80), radius)
    displacement[cluster] += (9.0, -7.0)
    others = np.ones(len(POINTS), bool)
    others[cluster] = False
    found = ask(np.arange(len(POINTS)), field(displacement, slopes), sure=others if sure else None)
    assert not found[cluster].any()
    assert found[others].all()


def test_both_sides_of_a_crack_are_confirmed():
    displacement = np.where(POINTS[:, :1] < 120, (0.0, -8.0), (0.0, 8.0))
    assert ask(np.arange(len(POINTS)), field(displacement)).all()


def test_neighbours_without_a_match_do_not_agree():
    valid = np.zeros(len(POINTS), bool)
    one = near((100, 80), 4)[:1]
    valid[one] = True
    assert not ask(one, field(np.zeros((len(POINTS), 2))), valid=valid).any()


def test_where_there_are_no_neighbours_nothing_is_refused():
    some = near((100, 80), 8)
    points, shape = POINTS[some], np.random.default_rng(2).uniform(-20, 20, (len(some), 6))
    everyone = np.ones(len(some), bool)
    judged = confirmed(np.arange(len(some)), points, shape, everyone, ~everyone, np.ones(len(some)), SUBSET)
    assert judged.all()
    # but what is sure beside them is believed
    surest = everyone & False
    surest[0] = True
    judged = confirmed(np.arange(1, len(some)), points, shape, everyone, surest, surest.astype(float), SUBSET)
    assert not judged.all()


def test_nothing_asked_is_nothing_answered():
    assert ask(np.zeros(0, np.int64), field(np.zeros((len(POINTS), 2)))).shape == (0,)


def test_a_sure_one_is_refused_by_sure_ones_but_not_by_a_few():
    displacement = np.zeros((len(POINTS), 2))
    one = near((100, 80), 4)[:1]
    displacement[one] = (130.0, 0.0)  # a pattern that is like itself there
    everyone = np.ones(len(POINTS), bool)
    assert not ask(one, field(displacement), sure=everyone).any()
    two = np.array([0, 1])
    points, shape = np.array([[10.0, 10.0], [40.0, 10.0]]), np.zeros((2, 6))
    shape[1, 0] = 130.0
    assert confirmed(two, points, shape, two >= 0, two >= 0, np.ones(2), SUBSET).all()
