"""A context, a belief that knows the truth, and a noise-free robot to drive policies with."""

import hashlib
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from agents.sb3.policy_file import FORMAT
from agents.sb3.tensors import to_bytes
from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym.observation import Observer
from slam_gym.observation_cloud import CloudObserver
from slam_gym.policies import PolicyContext
from slam_gym.scenario import Scenario


class LinearActionMap:
    """Actions are commands divided by the limits."""

    def __init__(self, limits):
        self.limits = np.asarray(limits, dtype=np.float64)

    def to_action(self, command):
        return command / self.limits

    def to_command(self, action):
        return action * self.limits


@pytest.fixture
def make_context():
    def build(kind="unicycle", speed=1.0, turn=1.5, **changes):
        limits = (speed, math.pi / 6 if kind == "bicycle" else turn)
        settings = {
            "action_map": LinearActionMap(limits),
            "motion": MotionModel(kind=kind),
            "sensor": SensorModel(),
            "target": TargetModel(),
            "step_dt": 0.1,
            "speed_min": -0.4 * speed,
            "speed_max": speed,
            "turn_max": turn,
        }
        return PolicyContext(**{**settings, **changes})

    return build


def _wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@pytest.fixture
def make_belief():
    """belief(pose [L, 3], target [L, 2], velocity [L, 2], std, known): what a filter would say that is right."""

    def build(pose, target=(0.0, 0.0), velocity=(0.0, 0.0), std=0.05, known=True):
        pose = np.atleast_2d(np.asarray(pose, dtype=np.float64))
        lanes = len(pose)
        target = np.broadcast_to(np.asarray(target, dtype=np.float64), (lanes, 2)).copy()
        velocity = np.broadcast_to(np.asarray(velocity, dtype=np.float64), (lanes, 2))
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])

        def turned(v):
            return np.column_stack([c * v[:, 0] + s * v[:, 1], -s * v[:, 0] + c * v[:, 1]])

        cov = np.zeros((lanes, 2, 2))
        cov[:, [0, 1], [0, 1]] = np.square(std) * np.ones((lanes, 1))
        return SimpleNamespace(
            pose=pose,
            target_known=np.broadcast_to(np.asarray(known, dtype=np.bool_), (lanes,)).copy(),
            target_position=target,
            target_rel=turned(target - pose[:, :2]),
            target_rel_cov=cov,
            target_rel_velocity=turned(velocity),
        )

    return build


@pytest.fixture
def move():
    """move(pose [L, 3], command [L, 2], dt, wheelbase): one step without noise, Eqs (15) and (16) of the papers."""

    def step(pose, command, dt, wheelbase=None):
        v, turn = command[:, 0], command[:, 1]
        if wheelbase:
            east = pose[:, 0] + v * dt * np.cos(pose[:, 2] + turn)
            north = pose[:, 1] + v * dt * np.sin(pose[:, 2] + turn)
            return np.column_stack([east, north, _wrap(pose[:, 2] + v * dt * np.sin(turn) / wheelbase)])
        heading = _wrap(pose[:, 2] + turn * dt)
        return np.column_stack([pose[:, 0] + v * dt * np.cos(heading), pose[:, 1] + v * dt * np.sin(heading), heading])

    return step


@pytest.fixture
def drive(make_belief, move):
    """drive(policy, pose [L, 3], target(k) -> ([L, 2], [L, 2]), steps): final pose, and the commands [steps, L, 2]."""

    def run(policy, pose, target, steps, **belief):
        context = policy.context
        wheelbase = context.motion.wheelbase if context.is_bicycle else None
        pose = np.atleast_2d(np.asarray(pose, dtype=np.float64))
        policy.reset(np.arange(len(pose)), np.arange(len(pose)))
        commands = []
        for k in range(steps):
            position, velocity = target(k)
            action = policy.act(None, make_belief(pose, position, velocity, **belief))
            assert action.shape == (len(pose), 2)
            assert action.dtype == np.float64
            assert np.abs(action).max() <= 1.0
            commands.append(context.action_map.to_command(action))
            pose = move(pose, commands[-1], context.dt, wheelbase)
        return pose, np.array(commands)

    return run


@pytest.fixture
def write_policy():
    """write_policy(folder, seed, **settings): a policy file of random weights, as if trained with those settings."""

    def write(folder, seed=0, **settings):
        rng = np.random.default_rng(seed)
        cloud = settings.get("target_cloud", 0)
        size = (CloudObserver if cloud else Observer)(Scenario.load("default"), 1).size
        layer = {"weight": rng.normal(0.0, 0.1, (2, size)), "bias": rng.normal(0.0, 0.3, 2)}
        content = to_bytes({f"policy.action_net.{name}": value.astype(np.float32) for name, value in layer.items()})
        options = settings.get("target_cloud_options", {})
        told = {"scenario": "default", "estimator": "ekf", "set": [], "seed": seed, **settings}
        about = {
            "format": FORMAT, "algorithm": "PPO", "policy_kwargs": {"activation_fn": "Tanh"}, "action": "twist",
            "observation": {"size": size, "nearest_landmarks": 8, "sectors": 8, "target_cloud": cloud,
                            "target_cloud_options": options},
            "decision_dt": 0.4,
            "normalisation": None, "sha256": hashlib.sha256(content).hexdigest(),
            "training": {"settings": told, "hyperparameters": {"gamma": 0.98}},
        }  # fmt: skip
        folder.mkdir(parents=True)
        (folder / "weights.safetensors").write_bytes(content)
        (folder / "policy.json").write_text(json.dumps(about))
        return str(folder)

    return write
