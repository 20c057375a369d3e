"""PPO in one file, as CleanRL writes it: torch and the native vector environment, nothing else.

python examples/07_ppo_in_one_file.py [--scenario default] [--decisions 500000] [--lanes 256]

Everything that `slam-gym train` leaves to Stable-Baselines3 can be read, and changed, here.
"""

import time
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import torch
import tyro
from torch import nn
from torch.distributions import Normal

import slam_gym  # noqa: F401  (registers SlamTarget-v0)


@dataclass
class Args:
    """Settings, also of the command line."""

    scenario: str = "default"
    estimator: str = "ekf"
    decisions: int = 500_000  # of all lanes together
    lanes: int = 256
    rollout: int = 64  # decisions of a lane between two updates
    hold: int = 4  # simulation steps that an action lasts
    epochs: int = 5
    batch: int = 4096
    learning_rate: float = 7e-4
    gamma: float = 0.98
    gae_lambda: float = 0.95
    clip: float = 0.2
    seed: int = 0


class Agent(nn.Module):
    """Actor and critic, and the moments that observations are normalised with."""

    def __init__(self, size, actions, width=128):
        super().__init__()
        self.actor = nn.Sequential(nn.Linear(size, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh(),
                                   nn.Linear(width, actions))  # fmt: skip
        self.critic = nn.Sequential(nn.Linear(size, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh(),
                                    nn.Linear(width, 1))  # fmt: skip
        nn.init.orthogonal_(self.actor[-1].weight, 0.01)
        self.log_std = nn.Parameter(torch.full((actions,), -0.5))
        self.count, self.mean, self.var = 1e-4, torch.zeros(size), torch.ones(size)

    def normalised(self, observations, learn=False):
        x = torch.as_tensor(observations)
        if learn:  # moments of everything seen so far; Chan et al. 1979
            n, change = self.count + len(x), x.mean(0) - self.mean
            squares = self.var * self.count + x.var(0, correction=0) * len(x) + change**2 * self.count * len(x) / n
            self.mean, self.var, self.count = self.mean + change * len(x) / n, squares / n, n
        return ((x - self.mean) / (self.var + 1e-8).sqrt()).clamp(-10.0, 10.0)

    def value(self, x):
        return self.critic(x).squeeze(-1)

    def distribution(self, x):
        return Normal(self.actor(x), self.log_std.exp())


def collect(envs, agent, observations, args):
    """A rollout [T, L] and the returns so far; an episode that was cut off is continued by the critic."""
    rows, returns = [], []
    for _ in range(args.rollout):
        x = agent.normalised(observations, learn=True)
        policy = agent.distribution(x)
        action = policy.sample()
        observations, reward, terminated, truncated, infos = envs.step(action.clamp(-1.0, 1.0).numpy())
        reward = torch.as_tensor(reward, dtype=torch.float32) / 10.0
        cut = np.flatnonzero(truncated & ~terminated)
        if len(cut):
            last = agent.normalised(np.stack([infos["final_obs"][lane] for lane in cut]))
            reward[cut] += args.gamma * agent.value(last)
        done = torch.as_tensor(terminated | truncated)
        rows.append((x, action, policy.log_prob(action).sum(1), agent.value(x), reward, done.float()))
        returns.append(10.0 * rows[-1][4].mean().item())
    return [torch.stack(column) for column in zip(*rows, strict=True)], observations, float(np.mean(returns))


def advantages(value, reward, done, last_value, args):
    """Generalised advantage estimation; Eq. (16), Schulman et al. 2016."""
    advantage, running, following = torch.zeros_like(reward), torch.zeros(reward.shape[1]), last_value
    for t in reversed(range(len(reward))):
        delta = reward[t] + args.gamma * following * (1.0 - done[t]) - value[t]
        running = delta + args.gamma * args.gae_lambda * (1.0 - done[t]) * running
        advantage[t], following = running, value[t]
    return advantage


def update(agent, optimiser, rollout, last_value, args):
    """Clipped surrogate objective; Eq. (7), Schulman et al. 2017."""
    x, action, log_prob, value, reward, done = rollout
    advantage = advantages(value, reward, done, last_value, args)
    flat = [part.flatten(0, 1) for part in (x, action, log_prob, advantage, advantage + value)]
    for _ in range(args.epochs):
        for batch in torch.randperm(len(flat[0])).split(args.batch):
            x, action, before, gain, target = (part[batch] for part in flat)
            ratio = (agent.distribution(x).log_prob(action).sum(1) - before).exp()
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            clipped = ratio.clamp(1.0 - args.clip, 1.0 + args.clip)
            loss = -torch.min(gain * ratio, gain * clipped).mean() + 0.5 * (agent.value(x) - target).square().mean()
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimiser.step()


def main(args):
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    envs = gym.make_vec("SlamTarget-v0", num_envs=args.lanes, scenario=args.scenario, estimator=args.estimator,
                        scenario_options={"hold": args.hold})  # fmt: skip
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])
    optimiser = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)
    observations, _ = envs.reset(seed=args.seed)
    started, per_update = time.perf_counter(), args.lanes * args.rollout
    for number in range(1, max(1, args.decisions // per_update) + 1):
        with torch.no_grad():
            rollout, observations, earned = collect(envs, agent, observations, args)
            last_value = agent.value(agent.normalised(observations))
        update(agent, optimiser, rollout, last_value, args)
        speed = number * per_update / (time.perf_counter() - started)
        print(f"{number * per_update:>9,} decisions, reward {earned:+.3f} each, {speed:,.0f} decisions per second")
    envs.close()


if __name__ == "__main__":
    main(tyro.cli(Args))
