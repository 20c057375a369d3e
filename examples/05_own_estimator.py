"""An estimator of one's own, compared with ours: python examples/05_own_estimator.py [runs] [steps]"""

import sys

import numpy as np

from estimators import registry
from estimators.interface import TARGET
from estimators.single_lane import LaneBelief, SingleLaneEstimator
from estimators.testing import check_estimator
from slam_gym.evaluation import compare


@registry.register("frozen-map")
class FrozenMap(SingleLaneEstimator):
    """Forgets that a map is only as good as the pose was when it was made: watch its NEES."""

    def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
        known = None if target is None else (target[:2], target_cov[:2, :2])
        return {"pose": pose, "cov": pose_cov, "map": {}, "target": known, "overflow": 0}

    def predict_one(self, state, models, control, dt):
        v, w = control
        c, s, way = np.cos(state["pose"][2] + w * dt), np.sin(state["pose"][2] + w * dt), v * dt
        F = np.array([[1.0, 0.0, -way * s], [0.0, 1.0, way * c], [0.0, 0.0, 1.0]])
        G = dt * np.array([[c, -way * s], [s, way * c], [0.0, 1.0]])
        stds = [models.motion.speed_std + 0.1 * abs(v), models.motion.turn_std + 0.1 * abs(w)]
        state["pose"] = wrapped(state["pose"] + [way * c, way * s, w * dt])
        state["cov"] = F @ state["cov"] @ F.T + G @ np.diag(np.square(stds)) @ G.T
        if state["target"] is not None:
            state["target"] = state["target"][0], state["target"][1] + dt * np.eye(2)  # spreads by 1 m in a second
        return state

    def update_one(self, state, models, returns):
        R = np.diag(np.square([models.sensor.range_std, models.sensor.bearing_std]))
        for r, b, label in zip(returns.ranges, returns.bearings, returns.labels, strict=True):
            c, s = np.cos(state["pose"][2] + b), np.sin(state["pose"][2] + b)
            point, by_return = state["pose"][:2] + r * np.array([c, s]), np.array([[c, -r * s], [s, r * c]])
            by_pose = np.column_stack([np.eye(2), by_return[:, 1]])
            cov = by_pose @ state["cov"] @ by_pose.T + by_return @ R @ by_return.T
            if label == TARGET and models.target is not None:
                old, old_cov = state["target"] or (point, 1e6 * np.eye(2))
                K = old_cov @ np.linalg.inv(old_cov + cov)
                state["target"] = old + K @ (point - old), old_cov - K @ old_cov
            elif label in state["map"]:  # where the return puts the landmark, against where it is kept
                K = state["cov"] @ by_pose.T @ np.linalg.inv(cov)
                state["pose"] = wrapped(state["pose"] + K @ (state["map"][label][0] - point))
                state["cov"] = state["cov"] - K @ cov @ K.T
            elif label >= 0 and len(state["map"]) < self.max_landmarks:
                state["map"][int(label)] = point, cov
            else:
                state["overflow"] += int(label >= 0)
        return state

    def describe_one(self, state, models):
        belief = LaneBelief(state["pose"], state["cov"], landmark_ids=list(state["map"]))
        belief.landmarks, belief.landmark_covs = zip(*state["map"].values(), strict=True) if state["map"] else ((), ())
        if state["target"] is not None:  # in the coordinates of the scenario's target model, position first
            belief.target, belief.target_cov = np.zeros(len(self.target_names)), np.eye(len(self.target_names))
            belief.target[:2], belief.target_cov[:2, :2] = state["target"]
        return belief

    def counts_one(self, state):
        return {"overflow": state["overflow"]}


def wrapped(pose):
    return pose - [0.0, 0.0, 2.0 * np.pi * np.floor((pose[2] + np.pi) / (2.0 * np.pi))]


def main(runs=20, steps=400):
    print("passed:", ", ".join(check_estimator("frozen-map")))
    results = compare("open", ["ekf", "frozen-map", "dead-reckoning"], ["pursuit"], runs=runs, steps=steps, jobs=1)
    print(results.summary[["estimator", "robot_error_rmse", "target_error_rmse", "pose_nees_mean"]].round(3))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
