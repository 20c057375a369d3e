"""Whether a target flees: Bayes' rule by hand; and points that run from a robot, but not into walls."""

import math

import numpy as np
import pytest

from estimators.kernels import cloud_flight
from estimators.kernels.cloud_motion import COSINE, ROWS, SINE, SPEED, X, Y
from estimators.kernels.jit import jit

SETTINGS = (10.0, 10.0, 12.0, 0.25, 0.01, 0.2, 0.02, 0.5)
NO_ARENA = (math.inf, math.inf, *SETTINGS[2:])


@jit
def flees(log_odds, from_x, from_y, x, y, vx, vy, reach, seconds, settings):
    return cloud_flight.flees(log_odds, from_x, from_y, x, y, vx, vy, reach, seconds, settings)


@jit
def run_away(log_odds, rows, x, y, reach, settings):
    cloud_flight.run_away(log_odds, rows, x, y, reach, settings)


@pytest.mark.parametrize(("course", "away"), [(0.3, True), (-0.3, True), (0.8, False), (math.pi, False)])
def test_a_course_is_evidence_by_bayes_rule(course, away):
    """A target 3 m to the north east, seen for 0.1 s; 0.3 rad off straight away is within 30 deg."""
    way = math.pi / 4 + course
    odds = flees(0.2, 1.0, 1.0, 3.0, 3.0, math.cos(way), math.sin(way), 6.0, 0.1, SETTINGS)
    p, q = (0.92, 0.5) if away else (0.08, 0.5)
    assert odds == pytest.approx(0.2 + 0.1 * math.log(p / q))


@pytest.mark.parametrize("scene", [
    (0.0, 0.0, 7.0, 0.0, 1.0, 0.0), (0.0, 0.0, 3.0, 0.0, 0.1, 0.0), (6.0, 0.0, 9.0, 0.0, 1.0, 0.0),
])  # fmt: skip
def test_far_targets_slow_ones_and_those_at_a_wall_say_nothing(scene):
    assert flees(0.2, *scene, 6.0, 0.1, SETTINGS) == 0.2


def test_what_is_learned_stays_bounded_and_without_an_arena_nothing_is_a_wall():
    odds = 0.0
    for _ in range(1000):
        odds = flees(odds, 90.0, 0.0, 93.0, 0.0, 1.0, 0.0, 6.0, 0.1, NO_ARENA)
    assert odds == 3.0


def _points(places):
    rows = np.zeros((ROWS, len(places)))
    rows[[X, Y]] = np.array(places).T
    rows[COSINE], rows[SPEED] = -1.0, 0.7
    return rows


def test_points_in_reach_turn_straight_away_and_keep_their_speed():
    rows = _points([[3.0, 0.0], [0.0, -2.0], [8.0, 8.0]])
    run_away(40.0, rows, 0.0, 0.0, 6.0, SETTINGS)
    np.testing.assert_allclose(rows[[COSINE, SINE]].T, [[1, 0], [0, -1], [-1, 0]], atol=1e-12)
    np.testing.assert_array_equal(rows[SPEED], 0.7)


def test_at_a_wall_they_turn_as_little_as_keeps_them_inside():
    rng = np.random.default_rng(0)
    places = rng.uniform(-10, 10, (400, 2))
    rows = _points(places)
    run_away(40.0, rows, 1.0, 2.0, 99.0, SETTINGS)
    ways = np.arctan2(rows[SINE], rows[COSINE])
    ahead = places + rows[[COSINE, SINE]].T
    assert (np.abs(ahead) <= 10.0).all()
    for place, way in zip(places, ways, strict=True):
        away = math.atan2(place[1] - 2.0, place[0] - 1.0)
        turned = abs(math.remainder(way - away, math.tau))
        for smaller in np.arange(0.0, turned - 0.25, 0.5):
            left, right = (
                place + np.array([math.cos(away + s * smaller), math.sin(away + s * smaller)]) for s in (1, -1)
            )
            assert np.abs(left).max() > 10.0 and np.abs(right).max() > 10.0


@pytest.mark.parametrize("log_odds", [-3.0, -1.0, 0.0, 3.0])
def test_as_many_flee_as_are_likely_to(log_odds):
    rows = _points([[3.0, 0.0]] * 200)
    run_away(log_odds, rows, 0.0, 0.0, 6.0, SETTINGS)
    assert (rows[COSINE] == 1.0).sum() == round(200 / (1 + math.exp(-log_odds)))
