"""RL-Zoo's format without running what is in it."""

import pytest

pytest.importorskip("yaml")

from agents.sb3.hyperparameters import FOLDER, parse, read

ZOO = """
SlamTarget-v0:
  n_envs: 8
  n_timesteps: !!float 1e5
  policy: 'MlpPolicy'
  normalize: "dict(norm_obs=True, norm_reward=False)"
  gamma: 0.9
  learning_rate: lin_1e-3
  policy_kwargs: "dict(log_std_init=-2, net_arch=dict(pi=[64, 32], vf=[64]), activation_fn=nn.ReLU)"
discovery:
  gamma: 0.99
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "ppo.yml"
    path.write_text(ZOO)
    return path


class Algorithm:
    def __init__(self, policy, env, learning_rate=1.0, gamma=0.5, policy_kwargs=None, n_steps=1, ent_coef=0.0):
        pass


def test_sections_and_changes(file):
    plain, zone = read(file, "default", {}), read(file, "discovery", {"n_envs": 4})
    assert (plain.n_envs, plain.n_timesteps, zone.n_envs) == (8, 100_000, 4)
    assert plain.normalise == {"gamma": 0.9, "norm_obs": True, "norm_reward": False}
    assert zone.normalise["gamma"] == 0.99
    assert read(file, "default", {"normalize": False}).normalise is None
    assert read(file, "default", {"normalize": True}).normalise == {"gamma": 0.9}


def test_arguments_of_the_algorithm(file):
    torch = pytest.importorskip("torch")
    arguments = read(file, "default", {}).arguments(Algorithm)
    assert sorted(arguments) == ["gamma", "learning_rate", "policy_kwargs"]
    assert arguments["learning_rate"](0.5) == 0.5e-3
    assert arguments["policy_kwargs"] == {
        "log_std_init": -2, "net_arch": {"pi": [64, 32], "vf": [64]}, "activation_fn": torch.nn.ReLU,
    }  # fmt: skip
    with pytest.raises(ValueError, match=r"unknown hyperparameter 'gama'.*Did you mean 'gamma'"):
        read(file, "default", {"gama": 1}).arguments(Algorithm)
    with pytest.raises(ValueError, match=r"lin_NUMBER"):
        read(file, "default", {"learning_rate": "fast"}).arguments(Algorithm)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("gamma", 2, "gamma must be a number from 0 to 1; got 2"), ("gamma", "abc", "gamma must be a number"),
     ("learning_rate", -1, "of at least 0"), ("learning_rate", "lin_-1", "learning_rate must be a number"),
     ("n_steps", 0, "n_steps must be a whole number"), ("ent_coef", "x", "ent_coef must be a number; got 'x'")],
)  # fmt: skip
def test_numbers_that_no_training_can_use(name, value, message, file):
    with pytest.raises(ValueError, match=message):
        read(file, "default", {name: value}).arguments(Algorithm)


def test_numbers_and_words_as_an_algorithm_wants_them(file):
    pytest.importorskip("torch")
    arguments = read(file, "default", {"ent_coef": "auto_0.1", "n_steps": 16.0, "gamma": 1}).arguments(Algorithm)
    assert (arguments["ent_coef"], arguments["n_steps"], arguments["gamma"]) == ("auto_0.1", 16, 1)
    assert isinstance(arguments["n_steps"], int)


@pytest.mark.parametrize("text", ["__import__('os').system('true')", "dict(a=open('/etc/passwd'))", "nn.Linear",
                                  "dict(**x)", "1 +"])  # fmt: skip
def test_code_is_not_run(text):
    with pytest.raises(ValueError, match="only dict"):
        parse(text)


def test_literals():
    assert parse("{'a': [1, 2.5, True], 'b': dict(c=None, d='x')}") == {"a": [1, 2.5, True], "b": {"c": None, "d": "x"}}
    assert parse("dict(activation_fn=torch.nn.Tanh)") == {"activation_fn": "tanh"}


def test_what_is_wrong_with_a_file(file, tmp_path):
    other = tmp_path / "other.yml"
    for text, message in [("a: [", "no YAML"), ("CartPole-v1: {}", "needs a section 'SlamTarget-v0'"),
                          ("SlamTarget-v0: {gamma: 1}", "give --steps")]:  # fmt: skip
        other.write_text(text)
        with pytest.raises(ValueError, match=message):
            read(other, "default", {})
    with pytest.raises(ValueError, match="must be 'MlpPolicy'"):
        read(file, "default", {"policy": "CnnPolicy"})
    with pytest.raises(ValueError, match="n_envs must be a whole number"):
        read(file, "default", {"n_envs": 2.5}).n_envs  # noqa: B018


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_the_built_in_files(algorithm):
    sb3 = pytest.importorskip("stable_baselines3")
    chosen = read(FOLDER / f"{algorithm}.yml", "default", {})
    assert chosen.arguments(getattr(sb3, algorithm.upper()))["policy_kwargs"]["net_arch"]
    assert chosen.n_timesteps >= 100_000
