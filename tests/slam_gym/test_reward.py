import gymnasium as gym
import numpy as np
import pytest

import slam_gym  # noqa: F401  (registers the environment)
from slam_gym import reward


def episode(**kwargs):
    env = gym.make("SlamTarget-v0", scenario_options={"max_steps": 60}, **kwargs)
    _, info = env.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(60):
        action = rng.uniform(-1, 1, 2).astype(np.float32)
        before = info
        _, paid, _, _, info = env.step(action)
        yield action, before, paid, info


def test_every_term_is_what_the_page_says():
    for action, before, _, info in episode():
        capped = [min(info.get(name, 8.0), 8.0) for name in ("target_error", "target_error_rel")]
        assert info["reward_track"] == pytest.approx(-(2.0 * capped[0] + capped[1]) / 3.0)
        assert info["reward_pursue"] == pytest.approx(info["target_seen"] - 0.03 * info["target_distance"])
        assert info["reward_localise"] == pytest.approx(-min(info["robot_error"], 8.0))
        assert info["reward_effort"] == pytest.approx(-0.5 * float(np.sum(np.square(action, dtype=np.float64))))
        assert info["reward_explore"] == info["landmark_count"] - before["landmark_count"]
        assert info["reward_collision"] == before["collisions"] - info["collisions"]


def test_effort_is_of_the_action_that_was_carried_out():
    env = gym.make("SlamTarget-v0")
    env.reset(seed=0)
    *_, info = env.step(np.array([-3.0, 0.5], dtype=np.float32))
    assert info["reward_effort"] == pytest.approx(-0.5 * (1.0 + 0.25))


def test_the_reward_is_the_weighted_sum():
    chosen = {"track": 0.5, "pursue": 0.0, "explore": 2.0, "effort": 0.1}
    weights = {**reward.DEFAULT_WEIGHTS, **chosen}
    for _, _, paid, info in episode(reward=chosen):
        assert paid == pytest.approx(sum(weights[term] * info[f"reward_{term}"] for term in reward.TERMS))


def test_the_page_names_every_term_with_its_weight():
    for term, weight in reward.DEFAULT_WEIGHTS.items():
        row = next(line for line in reward.__doc__.splitlines() if line.startswith(f"| {term} "))
        assert float(row.split("|")[2]) == weight


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"pursuit": 1.0}, "Did you mean 'pursue'"),
        ({"track": np.inf}, "finite number"),
        ({"track": True}, "finite number"),
        ({"track": "1"}, "finite number"),
    ],
)
def test_wrong_weights(chosen, message):
    with pytest.raises(ValueError, match=message):
        reward.weights(chosen)
