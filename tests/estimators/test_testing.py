"""The conformance suite passes a sound filter and names what is wrong with broken ones."""

import inspect

import numpy as np
import pytest

from estimators import _checks
from estimators.interface import TARGET
from estimators.single_lane import LaneBelief, SingleLaneEstimator
from estimators.testing import CheckFailedError, check_estimator, checks


class Plain(SingleLaneEstimator):
    """EKF-SLAM with a target, written as a plug-in author would: one robot, NumPy, a dictionary as state."""

    def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
        n_t = len(self.target_names)
        state = {"mu": np.zeros(3 + n_t), "P": np.zeros((3 + n_t, 3 + n_t)), "ids": [], "known": False, "overflow": 0}
        state["mu"][:3], state["P"][:3, :3] = pose, pose_cov
        if target is not None:
            state["mu"][3:], state["P"][3:, 3:], state["known"] = target, target_cov, True
        return state

    def predict_one(self, state, models, control, dt):
        mu, P = state["mu"], state["P"]
        v, w = control
        end = mu[2] + w * dt
        F = np.eye(len(mu))
        F[:2, 2] = [-v * dt * np.sin(end), v * dt * np.cos(end)]
        G = np.zeros((len(mu), 2))
        G[:3] = dt * np.array([[np.cos(end), F[0, 2]], [np.sin(end), F[1, 2]], [0.0, 1.0]])
        mu[:3] += [v * dt * np.cos(end), v * dt * np.sin(end), w * dt]
        mu[2] = self.wrap(mu[2])
        state["P"] = F @ P @ F.T + G @ np.diag([models.motion.speed_std**2, models.motion.turn_std**2]) @ G.T
        if state["known"]:
            self.move_target(state, models.target, dt)
        return state

    def move_target(self, state, model, dt):
        mu = state["mu"]
        F, Q = np.eye(len(mu)), np.zeros((len(mu), len(mu)))
        if model.kind == "twist":
            end = mu[5] + model.turn_rate * dt
            c, s, way = np.cos(end), np.sin(end), model.speed * dt
            F[3:5, 5] = [-way * s, way * c]
            G = dt * np.array([[c, -way * s], [s, way * c], [0.0, 1.0]])
            Q[3:6, 3:6] = G @ np.diag([model.speed_std**2, model.turn_std**2]) @ G.T
            mu[3:6] += [way * c, way * s, model.turn_rate * dt]
            mu[5] = self.wrap(mu[5])
        else:
            F[3, 5] = F[4, 6] = dt
            q = model.acceleration_density**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
            Q[3:7, 3:7] = np.kron(q, np.eye(2))
            state["mu"] = F @ mu
        state["P"] = F @ state["P"] @ F.T + Q

    def update_one(self, state, models, returns):
        for r, b, label in zip(returns.ranges, returns.bearings, returns.labels, strict=True):
            if label == TARGET and models.target is not None:
                if state["known"]:
                    self.correct(state, models.sensor, 3, r, b)
                else:
                    self.meet_target(state, models, r, b)
            elif label in state["ids"]:
                j = 3 + len(self.target_names) + 2 * state["ids"].index(label)
                self.correct(state, models.sensor, j, r, b)
            elif label >= 0:
                self.append(state, models.sensor, label, r, b)
        return state

    def correct(self, state, sensor, j, r, b):
        mu, P = state["mu"], state["P"]
        d = mu[j : j + 2] - mu[:2]
        q = max(d @ d, 1e-12)
        A = np.array([[d[0] / np.sqrt(q), d[1] / np.sqrt(q)], [-d[1] / q, d[0] / q]])
        H = np.zeros((2, len(mu)))
        H[:, :2], H[1, 2], H[:, j : j + 2] = -A, -1.0, A
        y = np.array([r - np.sqrt(q), self.wrap(b - np.arctan2(d[1], d[0]) + mu[2])])
        S = H @ P @ H.T + np.diag([sensor.range_std**2, sensor.bearing_std**2])
        K = np.linalg.solve(S, H @ P).T
        mu += K @ y
        state["P"] = P - K @ S @ K.T
        mu[2] = self.wrap(mu[2])
        if len(self.target_names) == 3:
            mu[5] = self.wrap(mu[5])

    def place(self, state, sensor, r, b):
        c, s = np.cos(state["mu"][2] + b), np.sin(state["mu"][2] + b)
        G = np.array([[1.0, 0.0, -r * s], [0.0, 1.0, r * c]])
        noise = np.array([[c, -r * s], [s, r * c]])
        R = noise @ np.diag([sensor.range_std**2, sensor.bearing_std**2]) @ noise.T
        return np.add(state["mu"][:2], [r * c, r * s]), G @ state["P"][:3], R

    def append(self, state, sensor, label, r, b):
        if len(state["ids"]) == self.max_landmarks:
            state["overflow"] += 1
            return
        point, cross, R = self.place(state, sensor, r, b)
        c, s = np.cos(state["mu"][2] + b), np.sin(state["mu"][2] + b)
        own = cross[:, :2] + np.outer(cross[:, 2], [-r * s, r * c]) + R
        state["P"] = np.block([[state["P"], cross.T], [cross, own]])
        state["mu"] = np.append(state["mu"], point)
        state["ids"].append(int(label))

    def meet_target(self, state, models, r, b):
        point, cross, R = self.place(state, models.sensor, r, b)
        c, s = np.cos(state["mu"][2] + b), np.sin(state["mu"][2] + b)
        state["mu"][3:5], state["known"] = point, True
        P = state["P"]
        P[3:5] = cross
        P[:, 3:5] = cross.T
        P[3:5, 3:5] = cross[:, :2] + np.outer(cross[:, 2], [-r * s, r * c]) + R
        rest = range(5, 3 + len(self.target_names))
        for i in rest:
            P[i, i] = np.pi**2 / 3 if len(rest) == 1 else models.target.initial_speed_std**2

    def describe_one(self, state, models):
        mu, P, n_t = state["mu"], state["P"], len(self.target_names)
        marks = 3 + n_t + 2 * np.arange(len(state["ids"]))
        return LaneBelief(
            pose=mu[:3],
            pose_cov=P[:3, :3],
            target=mu[3 : 3 + n_t] if state["known"] else None,
            target_cov=P[3 : 3 + n_t, 3 : 3 + n_t],
            target_pose_cov=P[3 : 3 + n_t, :3],
            landmark_ids=state["ids"],
            landmarks=mu[3 + n_t :].reshape(-1, 2),
            landmark_covs=np.array([P[j : j + 2, j : j + 2] for j in marks]).reshape(-1, 2, 2),
            landmark_pose_covs=np.array([P[j : j + 2, :3] for j in marks]).reshape(-1, 2, 3),
        )

    def counts_one(self, state):
        return {"overflow": state["overflow"]}

    @staticmethod
    def wrap(angle):
        return (angle + np.pi) % (2 * np.pi) - np.pi


class DoublePrecisionLost(Plain):
    def describe_one(self, state, models):
        one = super().describe_one(state, models)
        one.pose_cov = one.pose_cov + np.triu(np.full((3, 3), 1e-3), 1)
        return one


class Unwrapped(Plain):
    @staticmethod
    def wrap(angle):
        return angle if abs(angle) < 3.5 else (angle + np.pi) % (2 * np.pi) - np.pi


class LeaksBetweenLanes(Plain):
    shared = 0.0

    def update_one(self, state, models, returns):
        LeaksBetweenLanes.shared = 0.5 * self.shared + 1e-6 * len(returns.ranges)
        state["mu"][0] += self.shared
        return super().update_one(state, models, returns)


class IgnoresLanes(Plain):
    def predict(self, control, dt, *, lanes=None):
        super().predict(control, dt)


class KeepsCounting(Plain):
    total = 0

    def update_one(self, state, models, returns):
        self.total += 1
        return super().update_one(state, models, returns)

    def counts_one(self, state):
        return {"overflow": state["overflow"], "sweeps": self.total}


class WritesIntoTheSweep(Plain):
    def update(self, scan, *, lanes=None):
        scan.bearings += 1e-9
        super().update(scan, lanes=lanes)


class FailsOnEmptySweeps(Plain):
    def update_one(self, state, models, returns):
        returns.ranges.max()
        return super().update_one(state, models, returns)


class InvertsThePrior(Plain):
    def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
        return super().reset_one(models, pose, np.linalg.inv(np.linalg.inv(pose_cov)), seed, target, target_cov)


class HidesOverflow(Plain):
    def counts_one(self, state):
        return {}


class NeedsATarget(Plain):
    def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
        self.speed = models.target.initial_speed_std
        return super().reset_one(models, pose, pose_cov, seed, target, target_cov)


class KnowsTheTargetTooSoon(Plain):
    def describe_one(self, state, models):
        one = super().describe_one(state, models)
        one.target = state["mu"][3 : 3 + len(self.target_names)] if self.target_names else None
        return one


class KeepsTimeElsewhere(Plain):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.times = np.zeros(self.num_lanes)

    def reset(self, *args, **kwargs):
        super().reset(*args, **kwargs)
        self.times[slice(None) if kwargs.get("lanes") is None else kwargs["lanes"]] = 0.0

    def predict(self, control, dt, *, lanes=None):
        self.times[slice(None) if lanes is None else lanes] += 1e-3
        super().predict(control + self.times[:, None], dt, lanes=lanes)


class CannotBePickled(Plain):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.hook = lambda: None


class LastReturnOnly(Plain):
    def update_one(self, state, models, returns):
        last = type(returns)(*(values[-1:] for values in returns[:3]), returns.complete)
        return super().update_one(state, models, last)


class ScalarTimeOnly(Plain):
    def predict(self, control, dt, *, lanes=None):
        super().predict(control, float(dt), lanes=lanes)


class DrawsFromTheClock(Plain):
    def predict_one(self, state, models, control, dt):
        state["mu"][0] += 1e-6 * np.random.default_rng().standard_normal()
        return super().predict_one(state, models, control, dt)


class DividesByTheGap(Plain):
    def correct(self, state, sensor, j, r, b):
        if r > 100.0:
            state["mu"] *= np.inf
        super().correct(state, sensor, j, r, b)


class ChangesWhenRead(Plain):
    def describe_one(self, state, models):
        state["mu"][0] += 1e-12
        return super().describe_one(state, models)


class TurnsTheWrongWay(Plain):
    def predict_one(self, state, models, control, dt):
        return super().predict_one(state, models, -control, dt)


class RefusesUnlabelled(Plain):
    def update_one(self, state, models, returns):
        if (returns.labels == -1).any():
            raise KeyError(-1)
        return super().update_one(state, models, returns)


class TwistUnknown(Plain):
    def move_target(self, state, model, dt):
        if model.kind == "twist":
            raise NotImplementedError("only constant velocity")
        super().move_target(state, model, dt)


class WrongShape(Plain):
    def _fill_core(self, buffers):
        super()._fill_core(buffers)
        buffers["target_known"] = buffers["target_known"].astype(float)


BROKEN = [
    (WrongShape, "shapes_and_dtypes", "must be bool"),
    (DoublePrecisionLost, "sound_belief", "symmetric"),
    (TurnsTheWrongWay, "follows_the_robot", "near the truth"),
    (LeaksBetweenLanes, "lanes_are_single_runs", "bit for bit"),
    (IgnoresLanes, "other_lanes_untouched", "left out"),
    (FailsOnEmptySweeps, "empty_sweeps", "ValueError"),
    (Unwrapped, "wrapped_headings", r"\[-pi, pi\)"),
    (InvertsThePrior, "degenerate_priors", "LinAlgError"),
    (HidesOverflow, "crowded_map", "counted"),
    (NeedsATarget, "no_target", "NoneType"),
    (TwistUnknown, "twist_target", "only constant velocity"),
    (KnowsTheTargetTooSoon, "target_seen_late", "before the first sighting"),
    (KeepsTimeElsewhere, "state_round_trip", "get_state"),
    (CannotBePickled, "pickling", "lambda"),
    (KeepsCounting, "reset_forgets", "zero after reset"),
    (DrawsFromTheClock, "repeatable", "same seeds"),
    (LastReturnOnly, "order_of_returns", "order"),
    (ScalarTimeOnly, "dt_per_lane", "TypeError"),
    (WritesIntoTheSweep, "inputs_unchanged", "in place"),
    (RefusesUnlabelled, "unlabelled_returns", "KeyError"),
    (DividesByTheGap, "rough_sweeps", "finite"),
    (ChangesWhenRead, "reading_changes_nothing", "read"),
]


def test_a_sound_filter_passes_every_check():
    assert check_estimator(Plain) == list(_checks.CHECKS)


@pytest.mark.parametrize(("cls", "name", "message"), BROKEN, ids=[row[0].__name__ for row in BROKEN])
def test_a_broken_filter_fails_the_right_check(cls, name, message):
    (check,) = [check for check in checks(cls) if check.name == name]
    with np.errstate(all="ignore"), pytest.raises(CheckFailedError, match=message) as caught:
        check()
    assert caught.value.check == name


def test_every_check_has_a_filter_that_fails_it():
    assert {row[1] for row in BROKEN} == set(_checks.CHECKS)


def test_every_check_says_what_it_checks():
    assert all(inspect.getdoc(function) for function in _checks.CHECKS.values())


def test_checks_take_names_and_options():
    with pytest.raises(ValueError, match="Did you mean"):
        checks("dead-rekoning")
    with pytest.raises(CheckFailedError, match="TypeError"):
        check_estimator(Plain, no_such_option=1)
