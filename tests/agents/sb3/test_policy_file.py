"""Policy files: what Stable-Baselines3 says, the file says; and nothing that could run code is read."""

import json
import pickle
import shutil
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import slam_gym
from slam_gym import policies
from slam_gym.episode import Episode
from slam_gym.evaluation_plan import Combination
from slam_gym.evaluation_unit import simulate
from slam_gym.observation import Observer
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec

pytest.importorskip("stable_baselines3")

import stable_baselines3 as sb3
import torch
from stable_baselines3.common.vec_env import VecNormalize

from agents.sb3.network import Network
from agents.sb3.policy_file import export_policy, find_policy, load_policy, load_sb3
from agents.sb3.tensors import read_tensors, to_bytes
from agents.sb3.vec_env import SlamTargetVecEnv

LANES = 4
SHOWN = {"nearest_landmarks": 4, "sectors": 6}
ENV = {**SHOWN, "scenario_options": {"max_steps": 20, "hold": 4}}


def make_venv():
    return SlamTargetVecEnv(gym.make_vec("SlamTarget-v0", num_envs=LANES, **ENV))


@pytest.fixture(scope="module")
def observations():
    """Of a few steps, [n, size]."""
    venv, rows = make_venv(), []
    venv.seed(0)
    rows.append(venv.reset())
    for step in range(6):
        rows.append(venv.step(np.full((LANES, 2), 0.1 * step, dtype=np.float32))[0])
    return np.concatenate(rows)


def build(algorithm, activation=torch.nn.Tanh, normalise=True, venv=None):
    venv = make_venv() if venv is None else venv
    if normalise:
        venv = VecNormalize(venv, clip_obs=3.0)
        venv.seed(0)
        venv.reset()
        for _ in range(5):
            venv.step(np.zeros((LANES, 2), dtype=np.float32))
    net = [16, 8]
    if algorithm is sb3.PPO:
        net = {"pi": [16, 8], "vf": [12]}
    model = algorithm("MlpPolicy", venv, policy_kwargs={"net_arch": net, "activation_fn": activation}, seed=3,
                      device="cpu")  # fmt: skip
    with torch.no_grad():  # away from the small initial actions
        for parameter in model.policy.parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
    return model


def export(model, folder):
    return export_policy(model, folder, action="twist", decision_dt=0.4, **SHOWN)


CASES = [
    (sb3.PPO, torch.nn.Tanh, True), (sb3.PPO, torch.nn.ReLU, False), (sb3.SAC, torch.nn.ReLU, True),
    (sb3.SAC, torch.nn.Tanh, False),
]  # fmt: skip


@pytest.mark.parametrize(("algorithm", "activation", "normalise"), CASES)
def test_the_file_acts_as_the_model_does(algorithm, activation, normalise, observations, tmp_path):
    model = build(algorithm, activation, normalise)
    digest = export(model, tmp_path / "one")
    settings, network = load_policy(tmp_path / "one")
    assert settings["sha256"] == digest
    action = np.zeros((len(observations), 2))
    network.act(observations, np.arange(len(observations)), action)
    seen = model.get_vec_normalize_env().normalize_obs(observations) if normalise else observations
    expected, _ = model.predict(seen, deterministic=True)
    np.testing.assert_allclose(action, expected, atol=2e-5)
    assert 0.05 < action.std() < 1.0

    back = load_sb3(tmp_path / "one", make_venv())
    for name, value in model.policy.state_dict().items():
        assert torch.equal(value, back.policy.state_dict()[name]), name
    assert (back.get_vec_normalize_env() is not None) == normalise
    assert export(back, tmp_path / "two") == digest


def test_actions_do_not_depend_on_the_number_of_lanes(observations, tmp_path):
    export(build(sb3.PPO), tmp_path)
    network = load_policy(tmp_path)[1]
    together = np.zeros((len(observations), 2))
    network.act(observations, np.arange(len(observations)), together)
    for i, row in enumerate(observations):
        alone = np.zeros((1, 2))
        network.act(row[None].copy(), np.zeros(1, dtype=np.int64), alone)
        np.testing.assert_array_equal(alone[0], together[i])


# ---------------------------------------------------------------------------------------------------- driving with it


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("policy")
    export(build(sb3.PPO), path)
    return path


def test_it_drives_as_in_its_environment(folder):
    """The policy under `Episode` decides as the network does in the environment, an action lasting 4 steps."""
    scenario = Scenario.load("default", max_steps=12)
    episode = Episode(scenario, ["ekf"], policy=("learned", {"path": str(folder)}), seed=5)
    env = gym.make("SlamTarget-v0", **ENV).unwrapped
    shown, _ = env.reset(seed=5)
    network = load_policy(folder)[1]
    for _ in range(3):
        action = np.zeros((1, 2))
        network.act(shown[None], np.zeros(1, dtype=np.int64), action)
        for _ in range(4):
            episode.step()
        shown, *_ = env.step(action[0])
        np.testing.assert_allclose(episode.simulation.world.pose, env.simulation.world.pose, atol=1e-6)


@pytest.mark.parametrize("options", [{}, {"evasive": True}], ids=["plain", "evasive"])
def test_it_is_shown_the_cloud_that_it_was_trained_with(options, write_policy, tmp_path):
    """As the environment shows it: same points, same actions."""
    cloud = {"target_cloud": 32, "target_cloud_options": options}
    path = write_policy(tmp_path / "cloudy", **cloud)
    episode = Episode(Scenario.load("discovery", max_steps=40), ["ekf"], policy=path, seed=5)
    env = gym.make("SlamTarget-v0", scenario="discovery", scenario_options={"hold": 4}, **cloud).unwrapped
    shown, _ = env.reset(seed=5)
    network = load_policy(tmp_path / "cloudy")[1]
    for _ in range(10):
        action = np.zeros((1, 2))
        network.act(shown[None], np.zeros(1, dtype=np.int64), action)
        for _ in range(4):
            episode.step()
        shown, *_ = env.step(action[0])
    np.testing.assert_allclose(episode.simulation.world.pose, env.simulation.world.pose, atol=1e-6)
    clouds = [simulation.clouds[0] for simulation in (episode.simulation, env.simulation)]
    np.testing.assert_array_equal(clouds[0].points()[0], clouds[1].points()[0])
    assert [cloud.evasive for cloud in clouds] == [bool(options)] * 2


def test_compare_drives_with_it(folder):
    spec = Spec.parse(f"learned:path={folder}")
    combination = Combination(Scenario.load("default", max_steps=12), spec, (Spec.parse("ekf"),), 0)
    both = simulate(combination, 1, [0, 1])[0]
    alone = simulate(combination, 1, [1])[0]
    np.testing.assert_array_equal(both.values[1], alone.values[0])


def test_it_says_what_is_missing(folder, tmp_path):
    context = policies.PolicyContext.from_scenario(Scenario.load("default"))
    with pytest.raises(ValueError, match=r"needs a folder, as .* learned:path="):
        policies.make("learned", context)
    with pytest.raises(FileNotFoundError, match="no policy in"):
        policies.make("learned", context, path="/nowhere")
    training = tmp_path / "runs" / "mine"
    shutil.copytree(folder, training / "best")
    with pytest.raises(FileNotFoundError, match=rf"no policy in .*Trainings within: {training}"):
        policies.make("learned", context, path=str(tmp_path / "runs"))
    policy = policies.make("learned", context, 2, path=str(folder))
    policy.reset(np.arange(2), np.arange(2))
    with pytest.raises(ValueError, match="got none"):
        policy.act(None, None)
    with pytest.raises(ValueError, match=r"got one of shape \(2, 3\)"):
        policy.act(np.zeros((2, 3)), None)
    wheels = policies.PolicyContext.from_scenario(Scenario.load("default"), "wheels")
    with pytest.raises(ValueError, match="trained to give 'twist' actions"):
        policies.make("learned", wheels, path=str(folder))


def test_lanes_begin_their_own_actions(folder):
    scenario = Scenario.load("default")
    policy = policies.make("learned", policies.PolicyContext.from_scenario(scenario), 2, path=str(folder))
    size = Observer(scenario, 2, **policy.observation_options).size
    rng, lanes = np.random.default_rng(0), np.arange(2)
    policy.reset(lanes, lanes)
    actions = []
    for call in range(6):
        if call == 2:
            policy.reset(lanes[1:], lanes[1:])
        actions.append(policy.act(rng.uniform(-1, 1, (2, size)).astype(np.float32), None))
    changed = np.any(np.diff(actions, axis=0) != 0.0, axis=2)  # [5, L]
    assert changed[:, 0].tolist() == [False, False, False, True, False]
    assert changed[:, 1].tolist() == [False, True, False, False, False]


# -------------------------------------------------------------------------------------------------------- what is read


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("code from a policy file was run",))


def test_pickles_and_zips_are_refused(tmp_path):
    model = build(sb3.PPO, normalise=False)
    model.save(tmp_path / "model.zip")
    torch.save(model.policy.state_dict(), tmp_path / "weights.pt")
    (tmp_path / "normalise.pkl").write_bytes(pickle.dumps(Bomb()))
    for name, what in [("model.zip", "zip archive"), ("weights.pt", "zip archive"), ("normalise.pkl", "pickle")]:
        with pytest.raises(ValueError, match=rf"{what}.*can run any code.*export_policy"):
            find_policy(tmp_path / name)
    export(model, tmp_path / "policy")
    (tmp_path / "policy" / "weights.safetensors").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(ValueError, match="Python pickle, which can run any code"):
        load_policy(tmp_path / "policy")


def test_damaged_files_are_named(folder, tmp_path):
    settings = json.loads((folder / "policy.json").read_text())
    weights = (folder / "weights.safetensors").read_bytes()

    def read(settings=settings, weights=weights):
        text = settings if isinstance(settings, str) else json.dumps(settings)
        (tmp_path / "policy.json").write_text(text)
        (tmp_path / "weights.safetensors").write_bytes(weights)
        return load_policy(tmp_path)

    read()
    for wrong, message in [
        ({"settings": "{"}, "is no JSON"),
        ({"settings": []}, "of format None"),
        ({"settings": {**settings, "format": "slam-gym policy 9"}}, "slam-gym policy 9"),
        ({"settings": {**settings, "algorithm": "DQN"}}, "damaged: KeyError"),
        ({"settings": {**settings, "observation": {"size": 7}}}, "settings for 7"),
        ({"weights": weights[:-4]}, "cannot stand at bytes"),
        ({"weights": b"12"}, "header's length"),
        ({"weights": (10**9).to_bytes(8, "little") + weights[8:]}, "header's length"),
        ({"weights": to_bytes({"policy.action_net.weight": np.zeros((2, 3), dtype=np.float32)})}, "damaged: KeyError"),
    ]:
        with pytest.raises(ValueError, match=message):
            read(**wrong)


def test_weights_that_are_not_those_described_are_refused(folder, tmp_path):
    tensors = read_tensors(folder / "weights.safetensors")
    tensors["policy.action_net.bias"][0] += 0.5
    (tmp_path / "weights.safetensors").write_bytes(to_bytes(tensors))
    (tmp_path / "policy.json").write_text((folder / "policy.json").read_text())
    with pytest.raises(ValueError, match=r"not the file that policy\.json describes: another SHA-256"):
        load_policy(tmp_path)


def test_other_models_are_not_written(tmp_path):
    model = sb3.TD3("MlpPolicy", make_venv(), device="cpu")
    with pytest.raises(ValueError, match="holds PPO or SAC; got TD3"):
        export(model, tmp_path)
    with pytest.raises(ValueError, match="fit together"):
        Network([(np.zeros((3, 4)), np.zeros(3)), (np.zeros((2, 4)), np.zeros(2))], "tanh", "clip")
    with pytest.raises(ValueError, match="2 components"):
        Network([(np.zeros((3, 4)), np.zeros(3))], "tanh", "clip")
    with pytest.raises(ValueError, match="one of tanh, relu"):
        Network([(np.zeros((2, 4)), np.zeros(2))], "gelu", "clip")


def test_tensors_survive_a_round_trip(tmp_path):
    tensors = {
        "b": np.arange(6, dtype=np.float32).reshape(2, 3), "a": np.array(2.5), "n": np.array([3, 4]),
        "flag": np.array([True, False]), "empty": np.zeros((0, 3)),
    }  # fmt: skip
    file = tmp_path / "x.safetensors"
    file.write_bytes(to_bytes(tensors))
    back = read_tensors(file)
    assert sorted(back) == sorted(tensors)
    for name, array in tensors.items():
        assert back[name].dtype == array.dtype
        np.testing.assert_array_equal(back[name], array)
    assert to_bytes(dict(reversed(tensors.items()))) == to_bytes(tensors)
    with pytest.raises(ValueError, match="complex128"):
        to_bytes({"z": np.zeros(2, dtype=np.complex128)})


def test_the_reference_implementation_reads_it(tmp_path):
    safetensors = pytest.importorskip("safetensors.numpy")
    file = tmp_path / "x.safetensors"
    file.write_bytes(to_bytes({"a": np.arange(3.0)}))
    np.testing.assert_array_equal(safetensors.load_file(file)["a"], np.arange(3.0))


def test_an_observation_is_built_only_where_one_is_needed():
    from slam_gym.policy_view import PolicyView

    scenario = Scenario.load("default")
    blind = policies.make("pursuit", policies.PolicyContext.from_scenario(scenario))
    assert PolicyView(blind, scenario).observe(SimpleNamespace(world=None)) is None
    assert slam_gym.__version__
