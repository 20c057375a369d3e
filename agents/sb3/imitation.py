"""A start from a teacher: a policy that exists already is imitated before the first trial.

From scratch, half of a training goes into what `pursuit` does already. DAgger (Ross, Gordon and Bagnell 2011) gets
there in a tenth of the decisions: the teacher drives first, then the student, while the teacher says at each decision
what it would have done; the actor is fitted to all of that by least squares. What follows is reinforcement learning as
ever, but for a short time in which only the critic learns: advantages by a critic that knows nothing would undo the
imitation.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from slam_gym.policies import Policy

if TYPE_CHECKING:
    from stable_baselines3 import PPO

ROUNDS = 5  # each adds as many decisions and fits anew; in the first the teacher drives
EPOCHS = 5  # of a round, over everything seen so far
BATCH = 1024
LEARNING_RATE = 1e-3


def imitate(model: "PPO", teacher: Policy, decisions: int, seeds: NDArray[np.int64]) -> float:
    """Fit a model's actor to a teacher.

    Args:
        model: on its environments, which go on from where the imitation leaves them.
        teacher: for as many lanes.
        decisions: of all lanes together that the teacher comments on.
        seeds: [L] of the teacher.

    Returns:
        Mean squared difference between the actor's and the teacher's actions in the last round, before its fit.
    """
    venv: Any = model.get_env()
    lanes, steps = np.arange(venv.num_envs), max(1, round(decisions / ROUNDS / venv.num_envs))
    optimiser = torch.optim.Adam(_actor(model), lr=LEARNING_RATE)
    rng = np.random.default_rng(int(seeds[0]))
    observations: list[NDArray[np.float32]] = []
    advice: list[NDArray[np.float32]] = []
    shown, error = venv.reset(), np.nan
    teacher.reset(lanes, seeds)
    for driven in range(ROUNDS):
        errors = []
        for _ in range(steps):
            raw: Any = venv.get_original_obs() if isinstance(venv, VecNormalize) else shown
            told = teacher.act(raw, venv.unwrapped.envs.unwrapped.belief).astype(np.float32)
            own = model.predict(shown, deterministic=True)[0]
            errors.append(float(np.mean(np.square(own - told))))
            observations.append(np.array(raw))
            advice.append(told)
            shown, _, dones, _ = venv.step(own if driven else told)
            over = np.flatnonzero(dones)
            teacher.reset(over, seeds[over])
        error = float(np.mean(errors))
        _fit(model, optimiser, np.concatenate(observations), np.concatenate(advice), rng)
    return error


def _actor(model: "PPO") -> list[torch.nn.Parameter]:
    """Parameters that decide about actions, but for their spread."""
    policy: Any = model.policy
    return [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]


def _fit(model: "PPO", optimiser: Any, observations: Any, advice: Any, rng: np.random.Generator) -> None:
    """Least squares over everything seen so far, normalised as it is now."""
    normalise = model.get_vec_normalize_env()
    x = torch.as_tensor(observations if normalise is None else normalise.normalize_obs(observations))
    y = torch.as_tensor(advice)
    for _ in range(EPOCHS):
        for batch in np.array_split(rng.permutation(len(x)), max(1, len(x) // BATCH)):
            said = model.policy.get_distribution(x[batch].float()).mode()
            loss = torch.nn.functional.mse_loss(said, y[batch])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()


class CriticFirst(BaseCallback):
    """Keeps the actor as it is until the critic has seen a number of decisions.

    Args:
        decisions: of all lanes together.
    """

    def __init__(self, decisions: int) -> None:
        super().__init__()
        self.decisions = decisions

    def _on_rollout_start(self) -> None:
        model: Any = self.model
        rests = model.num_timesteps < self.decisions
        for parameter in (*_actor(model), model.policy.log_std):
            parameter.requires_grad_(not rests)

    def _on_step(self) -> bool:
        return True
