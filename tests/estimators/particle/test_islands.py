"""Islands: groups of particles that weigh and resample among themselves."""

import numpy as np
import pytest

from estimators._recording import MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.particle.islands import draw_survivors, weigh
from estimators.particle.layout import LANE
from estimators.particle.slamto import SLAMTO

ISLANDS, SIZE = 3, 20


def weighed(log_w, threshold):
    state, w = np.zeros(1, dtype=LANE), np.empty(log_w.size)
    weigh(0, state, log_w, w, ISLANDS, threshold)
    return state, w


def test_every_island_has_its_share_of_the_weight_and_its_own_effective_number():
    rng = np.random.default_rng(0)
    log_w = rng.normal(scale=[[0.1], [3.0], [0.1]], size=(ISLANDS, SIZE)) + np.array([[0.0], [5.0], [-700.0]])
    expected = np.exp(log_w - log_w.max(axis=1, keepdims=True))
    expected /= expected.sum(axis=1, keepdims=True)
    state, w = weighed(log_w.ravel(), 0.5)
    np.testing.assert_allclose(w.reshape(ISLANDS, SIZE), expected / ISLANDS, rtol=1e-12)
    assert state["due"][0] == 0b010


def test_survivors_come_from_their_own_island_where_it_is_due():
    rng = np.random.default_rng(1)
    log_w = rng.normal(scale=[[3.0], [0.1], [3.0]], size=(ISLANDS, SIZE)).ravel()
    state, w = weighed(log_w, 0.5)
    before, (copies, source, destination) = w.copy(), np.zeros((3, w.size), dtype=np.int64)
    count = draw_survivors(0, state, log_w, w, ISLANDS, copies, source, destination)
    particles = np.arange(w.size)
    particles[destination[:count]] = source[:count]
    np.testing.assert_array_equal(particles // SIZE, np.arange(w.size) // SIZE)
    drawn, wanted = np.bincount(particles, minlength=w.size), before * w.size
    due = np.arange(w.size) // SIZE != 1
    assert (np.abs(drawn - wanted)[due] < 1.0).all()
    np.testing.assert_array_equal(drawn[~due], 1)
    np.testing.assert_allclose(w[due], 1.0 / w.size)
    np.testing.assert_array_equal(w[~due], before[~due])
    assert state["due"][0] == 0
    assert state["resampled"][0] == 2


@pytest.mark.parametrize("association", ["known", "nearest"])
def test_no_history_spreads_beyond_its_island(association):
    """Islands that start a hundred metres apart stay so, resampled or not, and keep their share of the weight."""
    recording = record(1, 30, labelled=association == "known")
    f = SLAMTO(MOTION, SENSOR, TARGET_MODEL, max_landmarks=12, particles=60, islands=3, association=association)
    start(f, recording)
    state = f.get_state()
    state["pose"][0, 0] += np.repeat([0.0, 100.0, 200.0], 20)
    f.set_state(state)
    feed(f, recording)
    assert f.counts["resampled"][0] > 5
    x, w = f.belief.particles(0)
    np.testing.assert_array_equal(np.round(x[:, 0] - x[0, 0], -2), np.repeat([0.0, 100.0, 200.0], 20))
    np.testing.assert_allclose(w.reshape(3, 20).sum(axis=1), 1.0 / 3.0)


@pytest.mark.parametrize("islands", [0, 3, 20, 63])
def test_wrong_numbers_of_islands(islands):
    with pytest.raises(ValueError, match="equal groups of at least two particles"):
        SLAMTO(MOTION, SENSOR, None, max_landmarks=2, particles=20, islands=islands)
