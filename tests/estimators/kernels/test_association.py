import math

import numpy as np
import pytest

from estimators.interface import TARGET, UNKNOWN
from estimators.kernels import association as a
from estimators.models import MotionModel, SensorModel, TargetModel, pack_models

LANDMARKS = np.array([[3.0, 1.0], [3.0, -1.0], [-2.0, 2.0]])
TARGET_AT = np.array([0.0, 3.0])
MODEL = pack_models(MotionModel(), SensorModel(range_std=0.05, bearing_std=0.02), TargetModel())[()]


def polar(point):
    return math.hypot(*point), math.atan2(point[1], point[0])


def associate(points, labels=None, target_known=True, slack=1e-3, match_gate=9.21, new_gate=25.0):
    """Slots of returns from these points, seen from the origin; everything uncertain by `slack` [m^2]."""
    n = 16
    mu, P = np.zeros((1, n)), np.zeros((1, n, n))
    mu[0, 3:5], mu[0, 7:13] = TARGET_AT, LANDMARKS.ravel()
    P[0, range(3, 13), range(3, 13)] = slack
    returns = np.array([polar(p) for p in points]).reshape(-1, 2)
    labels = np.full(len(points), UNKNOWN) if labels is None else np.array(labels)
    slots = np.zeros((1, len(points)), dtype=np.int64)
    a.nearest(
        0, mu, P, MODEL, 4, 3, target_known, returns[None, :, 0].copy(), returns[None, :, 1].copy(), labels[None],
        len(points), match_gate, new_gate, np.zeros((len(points), 4)), slots,
    )  # fmt: skip
    return slots[0].tolist()


def test_known_labels():
    ids = np.array([[7, 3, -1]])
    known = [a.slot_by_label(ids, 0, 2, label, 1.0, 0.0, True) for label in (3, 7, 5, TARGET, UNKNOWN)]
    assert known == [1, 0, a.NEW, a.TARGET_SLOT, a.DROPPED]
    assert a.slot_by_label(ids, 0, 2, TARGET, 1.0, 0.0, False) == a.DROPPED
    assert a.slot_by_label(ids, 0, 2, 3, math.nan, 0.0, True) == a.DROPPED


def test_everything_at_its_place():
    assert associate([*LANDMARKS[::-1], TARGET_AT]) == [2, 1, 0, a.TARGET_SLOT]


def test_an_unknown_target_is_a_new_landmark():
    assert associate([TARGET_AT], target_known=False) == [a.NEW]


def test_the_target_is_told_by_its_label_only_once():
    assert associate([TARGET_AT, TARGET_AT], [TARGET, UNKNOWN]) == [a.TARGET_SLOT, a.DROPPED]


def test_ids_are_not_looked_at():
    assert associate([LANDMARKS[0]], [2]) == [0]


def test_far_away_is_new_and_the_dead_zone_is_dropped():
    near = LANDMARKS[0] * (1 + 4.0 * 0.05 / polar(LANDMARKS[0])[0])  # about 4 deviations further out
    assert associate([[6.0, 6.0], near], slack=1e-6) == [a.NEW, a.DROPPED]


def test_one_landmark_takes_the_better_of_two():
    slightly_off = LANDMARKS[0] + [0.03, 0.0]
    assert associate([slightly_off, LANDMARKS[0]]) == [a.DROPPED, 0]


def test_the_cheapest_pair_first():
    """A return between two landmarks yields to the one that fits its own better."""
    between = np.array([3.0, 0.05])
    assert associate([between, LANDMARKS[0]], slack=0.5) == [1, 0]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_unusable_returns_are_dropped(bad):
    assert associate([[bad, 1.0]]) == [a.DROPPED]


def test_nothing_seen():
    assert associate([]) == []
