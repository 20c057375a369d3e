"""Filters of the family on returns that nobody has labelled."""

import numpy as np
import pytest

from estimators.interface import UNKNOWN, Scan
from estimators.models import MotionModel, SensorModel
from estimators.registry import make
from estimators.testing import checks


@pytest.mark.parametrize("check", checks("ekf", association="jcbb"), ids=str)
def test_contract(check):
    check()


LANDMARK, FALSE = (4.0, 0.5), (3.0, -1.0)  # range [m], bearing [rad]


def sweep(*returns, complete=True):
    scan = Scan.empty(1, 4)
    scan.count[:], scan.complete[:], scan.labels[:] = len(returns), complete, UNKNOWN
    for k, (r, b) in enumerate(returns):
        scan.ranges[0, k], scan.bearings[0, k] = r, b
    return scan


def build(association="nearest", sensor=None, **options):
    sensor = {"clutter_rate": 1.0, "detection_probability": 0.9, "bearing_std": 0.02, **(sensor or {})}
    ekf = make("ekf", MotionModel(), SensorModel(**sensor), None, max_landmarks=6, association=association, **options)
    ekf.reset(np.zeros(3), np.diag([1e-4, 1e-4, 1e-5]), seeds=[0])
    return ekf


def feed(ekf, *sweeps):
    for scan in sweeps:
        ekf.predict(np.zeros((1, 2)), 0.1)
        ekf.update(scan)


@pytest.mark.parametrize("association", ["nearest", "jcbb"])
def test_a_false_alarm_never_reaches_the_belief_and_is_removed(association):
    ekf = build(association)
    feed(ekf, sweep(LANDMARK, FALSE))
    assert ekf.count[0] == 2  # in the state, with all cross covariances, from the first sighting on
    assert ekf.belief.landmark_count[0] == 0  # once is not enough where there are false alarms
    feed(ekf, *[sweep(LANDMARK)] * 4)
    assert ekf.count[0] == ekf.belief.landmark_count[0] == ekf.counts["removed"][0] == 1
    np.testing.assert_allclose(ekf.belief.landmark_mean[0, 0], [4.0 * np.cos(0.5), 4.0 * np.sin(0.5)], atol=0.05)
    assert ekf.belief.landmark_mapped[0].tolist() == [True] + [False] * 5


def test_without_false_alarms_a_landmark_is_there_at_once():
    ekf = build(sensor={"clutter_rate": 0.0})
    feed(ekf, sweep(LANDMARK))
    assert ekf.belief.landmark_count[0] == 1


def test_one_missed_detection_costs_nothing():
    ekf = build()
    feed(ekf, *[sweep(LANDMARK)] * 4, sweep())
    assert ekf.belief.landmark_count[0] == 1


@pytest.mark.parametrize(
    "case",
    [
        {"sensor": {"max_range": 4.05}},  # at the edge of the sensor's range
        {"sensor": {"field_of_view": 1.02}},  # at the edge of its view
        {"complete": False},  # the absence of a return says nothing
        {"options": {"remove_below": 0.0}},
        {"returns": [(4.2, 0.5)]},  # a return near it that was left undecided
    ],
)
def test_what_need_not_have_been_seen_stays(case):
    ekf = build(sensor=case.get("sensor"), **case.get("options", {}))
    feed(ekf, sweep(LANDMARK), *[sweep(*case.get("returns", ()), complete=case.get("complete", True))] * 8)
    assert ekf.count[0] == 1
    control = build()
    feed(control, sweep(LANDMARK), *[sweep()] * 8)
    assert control.count[0] == 0


def test_behind_a_mapped_pillar_a_landmark_need_not_be_seen():
    front, back = (2.0, 0.5), LANDMARK
    for radius, left in ((0.3, 2), (0.0, 1)):
        ekf = build(sensor={"landmark_radius": radius})
        feed(ekf, *[sweep(front, back)] * 3, *[sweep(front)] * 12)
        assert ekf.count[0] == left


def test_known_labels_are_believed():
    ekf = build("known")
    scan = sweep(LANDMARK)
    scan.labels[:] = 3
    feed(ekf, scan, *[sweep()] * 8)
    assert ekf.belief.landmark_id[0].tolist() == [3] + [-1] * 5


def test_what_a_probability_may_be():
    with pytest.raises(ValueError, match=r"below 0\.4"):
        build(remove_below=0.5)
