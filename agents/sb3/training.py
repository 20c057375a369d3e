"""One training, from its settings to a policy; `slam-gym train` without the command line."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, make_output_format
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

from agents.sb3 import checkpoint, hyperparameters, store
from agents.sb3.callbacks import CHECKPOINT, Milestones, Row
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.imitation import CriticFirst, imitate
from agents.sb3.vec_env import SlamTargetVecEnv
from slam_gym import policies, reward
from slam_gym.envs.slam_target_vector import SlamTargetVectorEnv
from slam_gym.evaluation import versions
from slam_gym.evaluation_plan import run_seeds
from slam_gym.results import write_json
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec, parse_settings

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from agents.sb3.train import Train

TRAINING_SEEDS, EVALUATION_SEEDS, TEACHER_SEEDS = 201, 202, 203  # purposes; comparisons draw theirs under others
ALGORITHMS: dict[str, type["BaseAlgorithm"]] = {"ppo": stable_baselines3.PPO, "sac": stable_baselines3.SAC}
ACTION_TIME = 0.4  # [s] that an action lasts where nobody says otherwise
CONFIG = "config.json"
MAY_CHANGE = ("out", "resume", "steps", "n_timesteps", "threads")  # between a training and its resumption
OF_A_SWEEP = ("seeds", "jobs", "backend", "address")  # settings that no single training is told
RESOLVED = ("hyperparams", "hyperparams_file", "num_envs")  # settings that are compared as hyperparameters

Report = Callable[[int, int, Row | None], None]  # (decisions so far, decisions altogether, evaluation if there was one)


@dataclasses.dataclass(frozen=True)
class Trained:
    """What came of a training.

    Attributes:
        out: its folder. rows: its evaluations. digest: SHA-256 of the last weights.
    """

    out: Path
    rows: list[Row]
    digest: str

    @property
    def best(self) -> Row:
        """The evaluation with the highest return."""
        return max(self.rows, key=lambda row: row["return"])


def train(settings: "Train", out: Path, *, command: str = "", report: Report = lambda *_: None) -> Trained:
    """Train, or go on with a training.

    Args:
        settings: see `agents.sb3.train.Train`.
        out: folder for everything.
        command: as typed, to be kept.
        report: told of progress.

    Raises:
        ValueError: impossible settings, a folder that is in use, or other settings than those resumed.
    """
    torch.set_num_threads(settings.threads)
    scenario = load_scenario(settings)
    check_reward(settings, scenario)
    chosen = read_hyperparameters(settings, scenario)
    config = describe(settings, chosen, command)
    saved = _check_folder(out, settings.resume, config)
    model = build(settings, scenario, chosen)
    seeds = list(map(int, run_seeds(settings.seed, EVALUATION_SEEDS, range(settings.evaluation_runs))))
    envs = make_environment(settings, scenario, settings.evaluation_runs, "NextStep")
    about = _about(settings, scenario, config)
    callback = Milestones(
        out, envs, seeds, settings.evaluate_every, about, lambda done, row: report(done, chosen.n_timesteps, row)
    )
    callbacks: list[BaseCallback] = [callback]
    if settings.teacher:
        callbacks.insert(0, CriticFirst(settings.teacher_decisions))
    if saved is not None:
        checkpoint.restore(model, saved["model"])
        callback.resume(saved["rows"])
    elif settings.teacher:
        imitate_teacher(model, settings, scenario)
    write_json(out / CONFIG, config)
    left = chosen.n_timesteps - model.num_timesteps
    if left > 0:
        model.set_logger(_logger(out))
        model.learn(left, callbacks, reset_num_timesteps=saved is None)
    return Trained(out, callback.rows, callback.digest)


def load_scenario(settings: "Train") -> Scenario:
    """The scenario with its changes, an action lasting as long as was asked for."""
    scenario = Scenario.load(settings.scenario, **parse_settings(settings.set))
    hold = settings.hold
    if hold is None:
        hold = scenario.hold if scenario.hold > 1 else max(1, round(ACTION_TIME / scenario.dt))
    return scenario.replace("hold", hold)


def check_reward(settings: "Train", scenario: Scenario) -> None:
    """Raises ValueError where nothing that a policy does would be paid for."""
    chosen = dict(zip(reward.TERMS, reward.weights(parse_settings(settings.reward)), strict=True))
    if not scenario.has_target:
        chosen.update(dict.fromkeys(reward.OF_THE_TARGET, 0.0))
    if not any(chosen.values()):
        why = "with these weights" if scenario.has_target else f"{scenario.name!r} has no target, so with these weights"
        raise ValueError(f"{why} every reward would be zero: give others, such as --reward localise=1 explore=1")


def read_hyperparameters(settings: "Train", scenario: Scenario) -> Hyperparameters:
    """From the YAML file and the command line."""
    changes = parse_settings(settings.hyperparams)
    if settings.steps is not None:
        changes["n_timesteps"] = settings.steps
    if settings.num_envs is not None:
        changes["n_envs"] = settings.num_envs
    built_in = f"{settings.algo}{'-taught' if settings.teacher and settings.algo == 'ppo' else ''}.yml"
    file = settings.hyperparams_file or hyperparameters.FOLDER / built_in
    return hyperparameters.read(file, scenario.name, changes)


def make_environment(
    settings: "Train", scenario: Scenario, lanes: int, autoreset_mode: str = "SameStep"
) -> SlamTargetVectorEnv:
    """The vector environment as the settings have it."""
    estimator = Spec.parse(settings.estimator)
    return SlamTargetVectorEnv(
        lanes, scenario=scenario, estimator=estimator.name, estimator_options=estimator.options,
        action=settings.action, reward=parse_settings(settings.reward), nearest_landmarks=settings.nearest_landmarks,
        sectors=settings.sectors, target_cloud=settings.target_cloud,
        target_cloud_options=parse_settings(settings.target_cloud_options), autoreset_mode=autoreset_mode,
    )  # fmt: skip


def build(settings: "Train", scenario: Scenario, chosen: Hyperparameters) -> "BaseAlgorithm":
    """The model on its environments, seeded: every lane's worlds are spawned from the seed, under a purpose.

    Raises:
        ValueError: what the algorithm does not accept.
    """
    algorithm = ALGORITHMS[settings.algo]
    arguments = {"device": "cpu", **chosen.arguments(algorithm)}
    if {"n_steps", "batch_size"} <= arguments.keys():  # a batch is never more than the rollout that it is drawn from
        arguments["batch_size"] = min(arguments["batch_size"], arguments["n_steps"] * chosen.n_envs)
    adapter = SlamTargetVecEnv(make_environment(settings, scenario, chosen.n_envs))
    venv: VecEnv = VecMonitor(adapter)
    if chosen.normalise is not None:
        venv = VecNormalize(venv, **chosen.normalise)
    try:
        model = algorithm("MlpPolicy", venv, seed=settings.seed, **arguments)
    except (TypeError, AssertionError) as error:  # how Stable-Baselines3 says it
        raise ValueError(f"{algorithm.__name__} does not accept these hyperparameters: {error}") from error
    adapter.seed_lanes(run_seeds(settings.seed, TRAINING_SEEDS, range(chosen.n_envs)).tolist())
    return model


def imitate_teacher(model: "BaseAlgorithm", settings: "Train", scenario: Scenario) -> float:
    """Begin with what a teacher does; see `agents.sb3.imitation`.

    Raises:
        ValueError: another algorithm than PPO, an unknown teacher, or one that is told the truth.
    """
    if not isinstance(model, stable_baselines3.PPO):
        raise ValueError(f"--teacher works with --algo ppo; got {settings.algo!r}")
    spec = policies.parse(settings.teacher)
    if policies.is_reference(spec.name):
        raise ValueError(
            f"teacher {spec.name!r} is told the truth, which a policy never sees; name one that reads the belief, such "
            "as 'pursuit'"
        )
    context = policies.PolicyContext.from_scenario(scenario, settings.action)
    teacher = policies.make(spec.name, context, model.n_envs, **spec.options)
    if teacher.needs_target_cloud and not settings.target_cloud:
        raise ValueError(
            f"teacher {spec.name!r} reads a target cloud: add --target-cloud {teacher.needs_target_cloud}, which the "
            "policy is then shown too"
        )
    seeds = run_seeds(settings.seed, TEACHER_SEEDS, range(model.n_envs))
    return imitate(model, teacher, settings.teacher_decisions, seeds)


def describe(settings: "Train", chosen: Hyperparameters, command: str) -> dict[str, Any]:
    """Everything that a training was told, of JSON types."""
    said = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in vars(settings).items()
        if name not in OF_A_SWEEP
    }
    packages = {"torch": torch.__version__, "stable-baselines3": stable_baselines3.__version__}
    config = {
        "command": command,
        "settings": said,
        "hyperparameters": chosen.values,
        "versions": {**versions(), **packages},
    }
    return json.loads(json.dumps(config))  # tuples as lists, as they are read again


def _check_folder(out: Path, resume: bool, config: dict[str, Any]) -> dict[str, Any] | None:
    """The checkpoint to go on from; None: a new training."""
    if not resume:
        check_folder_is_free(out)
        return None
    if not (out / CHECKPOINT).is_file():
        there = ", ".join(str(file.parent) for file in sorted(out.parent.glob(f"*/{CHECKPOINT}")))
        hint = f". Trainings beside it, for --out: {there}" if there else ""
        raise ValueError(f"nothing to resume: there is no {CHECKPOINT} in {str(out)!r}{hint}")
    before = json.loads((out / CONFIG).read_text(encoding="utf-8"))
    for part in ("settings", "hyperparameters"):
        old, new = before[part], config[part]
        for name in {**old, **new}:
            if name not in MAY_CHANGE + RESOLVED and old.get(name) != new.get(name):
                raise ValueError(
                    f"--resume goes on with the same settings: {name} was {old.get(name)!r}, not {new.get(name)!r}. "
                    f"The command was: {before['command']}"
                )
    return dict(store.load(out / CHECKPOINT))


def check_folder_is_free(out: Path) -> None:
    """Raises ValueError for a folder that a training would overwrite."""
    if (out / CHECKPOINT).exists():
        raise ValueError(f"{str(out)!r} holds a training already: go on with --resume, or choose another --out")


def _about(settings: "Train", scenario: Scenario, config: dict[str, Any]) -> dict[str, Any]:
    """What `export_policy` is told."""
    from slam_gym.actions import ActionMap

    return {
        "action": ActionMap(scenario, settings.action).kind,
        "decision_dt": float(scenario.dt * scenario.hold),
        "nearest_landmarks": settings.nearest_landmarks,
        "sectors": settings.sectors,
        "target_cloud": settings.target_cloud,
        "target_cloud_options": parse_settings(settings.target_cloud_options),
        "training": config,
    }


def _logger(out: Path) -> Logger:
    """To TensorBoard, where it is installed."""
    folder = str(out / "tensorboard")
    try:
        formats = [make_output_format("tensorboard", folder)]
    except (ImportError, AssertionError):
        formats = []
    return Logger(folder, formats)


def check_numbers(settings: "Train") -> None:
    """Raises ValueError for counts that are none."""
    for name in ("steps", "num_envs", "evaluate_every", "evaluation_runs", "teacher_decisions", "threads"):
        number = getattr(settings, name)
        if number is not None and not number >= 1:
            raise ValueError(f"--{name.replace('_', '-')} must be at least 1; got {number:g}")
    for seed in settings.seeds or (settings.seed,):
        if seed < 0 or seed >= np.iinfo(np.uint32).max:
            raise ValueError(f"--seed must be from 0 to 2^32 - 2; got {seed}")
