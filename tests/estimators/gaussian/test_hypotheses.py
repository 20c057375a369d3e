"""Hypotheses about the target: headings at its first sighting, modes of its motion; every filter by composition."""

import numpy as np
import pytest

from estimators import make
from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.manoeuvres import MODES, stationary, transition
from estimators.gaussian.mixture import NOWHERE, collapse
from estimators.interface import TARGET, Scan
from estimators.models import MODEL, MotionModel, SensorModel, TargetModel, pack_models

FILTERS = ["ekf", "fej-ekf", "ri-ekf", "cdkf", "dead-reckoning"]
IMM = TargetModel(kind="imm", initial_speed_std=0.5)
STILL = MotionModel(speed_std=0.0, turn_std=0.0)


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def sighting(x, y):
    scan = Scan.empty(1, 1)
    scan.count[0], scan.labels[0, 0] = 1, TARGET
    scan.ranges[0, 0], scan.bearings[0, 0] = np.hypot(x, y), np.arctan2(y, x)
    return scan


@pytest.mark.parametrize("name", ["ekf", "fej-ekf", "ri-ekf", "cdkf"])
def test_a_heading_is_found_in_every_direction(name):
    """Known from the first sighting on, with a heading as uncertain as the circle; settled after some."""
    model = TargetModel(kind="twist", speed=2.0, turn_rate=0.0, speed_std=0.2, turn_std=0.1)
    sensor = SensorModel(max_range=20.0, range_std=0.02, bearing_std=0.005)
    for heading in np.linspace(-3.0, 3.0, 7):
        estimator = make(name, STILL, sensor, model, max_landmarks=1)
        estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
        for step in range(12):
            point = np.array([5.0, 1.0]) + 0.2 * step * np.array([np.cos(heading), np.sin(heading)])
            estimator.update(sighting(*point))
            assert estimator.belief.target_known[0]
            if step == 0:
                assert estimator.bank.open[0]
                assert estimator.belief.target_heading_var[0] > 3.0
            estimator.predict(np.zeros((1, 2)), 0.1)
        assert not estimator.bank.open[0]
        assert abs(wrap(estimator.belief.target_heading[0] - heading)) < 0.1


def run(name, lanes, model, recording, steps):
    estimator = make(name, MOTION, SENSOR, model, num_lanes=lanes, max_landmarks=8)
    start(estimator, recording)
    feed(estimator, recording, 0, steps)
    return estimator


@pytest.mark.parametrize("kind", ["twist", "imm"])
@pytest.mark.parametrize("name", FILTERS)
def test_lanes_are_single_runs(name, kind):
    model = IMM if kind == "imm" else TargetModel(kind="twist", speed=0.2, turn_rate=0.0)
    recording = record(2, 6)
    both = run(name, 2, model, recording, 6)
    for lane in range(2):
        alone = run(name, 1, model, recording.lane(lane), 6)
        assert alone.bank.open[0]
        for ours, theirs in zip(alone.joint(0), both.joint(lane), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        assert np.linalg.eigvalsh(alone.joint(0)[1]).min() > -1e-9
        np.testing.assert_array_equal(alone.P[0], alone.P[0].T)


@pytest.mark.parametrize("model", [IMM, TargetModel(kind="twist", speed=0.2, turn_rate=0.0)], ids=["imm", "twist"])
def test_a_state_holds_the_hypotheses(model):
    recording = record(1, 12)
    first = run("fej-ekf", 1, model, recording, 6)
    state = first.get_state()
    second = make("fej-ekf", MOTION, SENSOR, model, max_landmarks=8)
    start(second, recording)
    second.set_state(state)
    for estimator in (first, second):
        feed(estimator, recording, 6)
    np.testing.assert_allclose(first.joint(0)[1], second.joint(0)[1], rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(first.bank.w, second.bank.w, rtol=1e-10, atol=1e-15)


def test_moments_of_a_mixture_against_numpy():
    rng = np.random.default_rng(0)
    size, n_t, n = 3, 3, 8
    mu, root = rng.standard_normal((size, n)), rng.standard_normal((size, n, n))
    mu[:, 2], mu[:, 5] = [3.1, -3.1, 3.0], [-3.0, 3.1, 3.0]  # headings across the cut
    mu[:, n - 2 :] = root[:, n - 2 :] = 0.0
    P, w = root @ np.swapaxes(root, 1, 2), np.array([[0.5, 0.2, 0.3]])
    models = np.zeros(size, dtype=MODEL)
    models[:] = pack_models(MOTION, SENSOR, TargetModel(kind="twist"))
    mean, cov = np.zeros((1, n)), np.zeros((1, n, n))
    collapse(mu, P, w, models, n_t, np.zeros(size, int), mean, cov, np.zeros((size + 1, n)), np.array([0]))
    unwrapped = mu.copy()
    unwrapped[:, [2, 5]] %= 2.0 * np.pi
    expected = w[0] @ unwrapped
    away = unwrapped - expected
    np.testing.assert_allclose(wrap(mean[0] - expected), 0.0, atol=1e-12)
    np.testing.assert_allclose(cov[0], np.einsum("g,gij->ij", w[0], P + away[:, :, None] * away[:, None]), atol=1e-12)


def test_the_chain_of_manoeuvres():
    """Rows are chances; nothing changes in no time; the stationary shares stay; turns lumped, steps compose."""
    models = np.array([pack_models(MOTION, SENSOR, IMM)] * 3)
    now, half, whole = transition(models, np.array([0.0, 0.4, 0.8]))
    np.testing.assert_allclose(now, np.eye(MODES), atol=1e-15)
    for chances in (half, whole):
        np.testing.assert_allclose(chances.sum(axis=1), 1.0)
        assert (chances > 0.0).all()
        np.testing.assert_allclose(stationary(models)[0] @ chances, stationary(models)[0])
    np.testing.assert_allclose((half @ half)[:, 0], whole[:, 0])


@pytest.mark.parametrize("name", ["ekf", "fej-ekf", "ri-ekf", "cdkf"])
def test_a_target_that_never_manoeuvres_has_one_mode(name):
    never = TargetModel(kind="imm", initial_speed_std=0.5, straight_duration=1e12)
    recording = record(1, 30)
    imm, plain = run(name, 1, never, recording, 30), run(name, 1, TARGET_MODEL, recording, 30)
    for ours, theirs in zip(imm.joint(0), plain.joint(0), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-7)


def test_a_turn_is_recognised():
    """Straight on for 2 s, then a bend to the left: the mode's weight follows, the velocity turns."""
    rng = np.random.default_rng(2)
    model = TargetModel(kind="imm", acceleration_density=0.1)
    estimator = make("ri-ekf", STILL, SensorModel(max_range=20.0, range_std=0.03, bearing_std=0.005), model,
                     max_landmarks=1)  # fmt: skip
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    position, heading = np.array([4.0, -2.0]), np.pi / 2.0
    for step in range(30):
        heading += 1.5 * DT if step >= 20 else 0.0
        position = position + DT * np.array([np.cos(heading), np.sin(heading)])
        estimator.predict(np.zeros((1, 2)), DT)
        estimator.update(sighting(*(position + 0.03 * rng.standard_normal(2))))
        if step == 19:
            assert estimator.bank.w[0].argmax() == 0
    assert estimator.bank.w[0].argmax() == 1
    assert abs(wrap(estimator.belief.target_heading[0] - heading)) < 0.3


def test_a_jump_starts_the_modes_anew():
    estimator = make("ri-ekf", STILL, SENSOR, TargetModel(kind="imm", reinitialise_nis=30.0), max_landmarks=1)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    estimator.update(sighting(2.0, 1.0))
    estimator.predict(np.zeros((1, 2)), DT)
    estimator.update(sighting(2.0, -3.0))
    assert estimator.counts["reinitialised"][0] == 1
    assert estimator.bank.open[0]
    np.testing.assert_allclose(estimator.belief.target_position[0], [2.0, -3.0], atol=1e-9)


def test_a_target_that_is_nowhere_starts_the_modes_anew():
    """Without any limit of the model's: what the modes share would grow until it overflows."""
    estimator = make("ri-ekf", STILL, SENSOR, TargetModel(kind="imm"), max_landmarks=1)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    estimator.update(sighting(2.0, 1.0))
    estimator.predict(np.zeros((1, 2)), DT)
    estimator.bank.members.P[:, 3:5, 3:5] = (2.0 * NOWHERE) ** 2 * np.eye(2)
    estimator.update(sighting(2.0, 1.5))
    assert estimator.counts["reinitialised"][0] == 1 and estimator.bank.open[0]
    np.testing.assert_allclose(estimator.belief.target_position[0], [2.0, 1.5], atol=1e-9)


def test_what_hypotheses_need():
    with pytest.raises(ValueError, match='association="known"'):
        make("ekf", MOTION, SENSOR, IMM, max_landmarks=2, association="nearest")
    with pytest.raises(ValueError, match="'gaussian-sum', 'two-sightings'"):
        make("ekf", MOTION, SENSOR, IMM, max_landmarks=2, first_heading="guess")
