"""What a comparison consists of: which estimators meet which policy in which scenario, and every run's seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from estimators import registry
from slam_gym import policies
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec

Ints = NDArray[np.int64]
Mode = Literal["shared", "closed-loop"]

DEFAULT_ESTIMATORS = ("ekf", "fej-ekf", "ri-ekf", "cdkf", "slamto", "independent", "dead-reckoning", "ideal-ekf")
DRIVERS = ("ri-ekf", "fej-ekf")  # the consistent Gaussian filters, whose belief a policy can rely on
WORLD_SEEDS, POLICY_SEEDS = 101, 102  # purposes; training draws its seeds under another one


@dataclass(frozen=True, slots=True)
class Combination:
    """One policy in one scenario with the estimators compared there."""

    scenario: Scenario
    policy: Spec
    estimators: tuple[Spec, ...]
    driver: int  # which estimator's belief the policy acts on, when the data are shared
    burn_in: int = 0  # first steps that are not scored
    weights: str = ""  # which a learned policy drives with

    @property
    def name(self) -> str:
        """For progress and messages."""
        return f"{self.scenario.name}, {self.policy.label}"


@dataclass(frozen=True, slots=True)
class Plan:
    """A whole comparison. Everything here changes numbers; how the work is cut up and spread does not."""

    combinations: tuple[Combination, ...]
    seed: int
    mode: Mode
    tracks: int  # first runs that are recorded in full
    score_map: bool = True

    def to_dict(self) -> dict[str, Any]:
        """JSON types; equal dictionaries mean equal numbers."""
        return {
            "seed": self.seed,
            "mode": self.mode,
            "tracks": self.tracks,
            **({} if self.score_map else {"score_map": False}),
            "combinations": [
                {
                    "scenario": c.scenario.to_dict(),
                    "policy": c.policy.to_dict(),
                    "weights": c.weights,
                    "estimators": [spec.to_dict() for spec in c.estimators],
                    "burn_in": c.burn_in,
                    "driver": c.estimators[c.driver].label if self.mode == "shared" else None,
                }
                for c in self.combinations
            ],
        }


def plan_from_dict(settings: Mapping[str, Any]) -> Plan:
    """What `Plan.to_dict` wrote."""
    combinations = []
    for item in settings["combinations"]:
        specs = tuple(Spec(**spec) for spec in item["estimators"])
        labels = [spec.label for spec in specs]
        driver = labels.index(item["driver"]) if item["driver"] is not None else 0
        scenario, policy = Scenario.load(item["scenario"]), Spec(**item["policy"])
        combinations.append(Combination(scenario, policy, specs, driver, item["burn_in"], item["weights"]))
    return Plan(
        tuple(combinations), settings["seed"], settings["mode"], settings["tracks"], settings.get("score_map", True)
    )


def make_plan(
    scenarios: Sequence[str | Scenario],
    estimators: Sequence[Any] | None,
    chosen_policies: Sequence[Any] | None,
    *,
    seed: int,
    mode: str,
    driver: str | None,
    steps: int | None,
    burn_in: int | None,
    tracks: int,
    score_map: bool = True,
    overrides: Mapping[str, Any],
    estimator_options: Mapping[str, Mapping[str, Any]],
    sweep: Mapping[str, Sequence[Any]] | None = None,
) -> Plan:
    """Check everything that can be wrong before any work starts.

    Raises:
        ValueError: an unknown name, an impossible option, or names given twice.
    """
    if mode not in ("shared", "closed-loop"):
        raise ValueError(f"mode must be 'shared' or 'closed-loop'; got {mode!r}")
    if steps is not None:
        if steps < 1:
            raise ValueError(f"steps must be at least 1; got {steps}")
        overrides = {**overrides, "max_steps": steps}
    loaded = [
        variant
        for scenario in _listed(scenarios)
        for variant in sweep_scenario(Scenario.load(scenario, **overrides), sweep or {})
    ]
    _distinct("scenario", [scenario.name for scenario in loaded])
    combinations = []
    for scenario in loaded:
        specs = _estimators(scenario, estimators, estimator_options)
        lead = _driver(specs, driver)
        unscored = _burn_in(scenario, burn_in)
        for policy in _policies(scenario, chosen_policies):
            weights = _try(scenario, policy, specs)
            combinations.append(Combination(scenario, policy, specs, lead, unscored, weights))
    return Plan(tuple(combinations), int(seed), mode, int(tracks), score_map)  # type: ignore[arg-type]


def sweep_scenario(scenario: Scenario, sweep: Mapping[str, Sequence[Any]]) -> list[Scenario]:
    """The scenario with every combination of the values given by dotted key, each named after them.

    The random draws are the same for all values, so that neighbours differ by the value alone.

    Raises:
        ValueError: a key without values, an unknown key, or an impossible value.
    """
    for key, values in sweep.items():
        if not len(values):
            raise ValueError(f"sweep {key!r} needs at least one value")
    if not sweep:
        return [scenario]
    variants = []
    for values in product(*sweep.values()):
        chosen = dict(zip(sweep, values, strict=True))
        name = f"{scenario.name} {' '.join(f'{key}={value}' for key, value in chosen.items())}"
        variants.append(Scenario.load(scenario, **chosen, name=name))
    return variants


def _burn_in(scenario: Scenario, chosen: int | None) -> int:
    """After one step from an exactly known start the covariance has not its full rank, and NEES means nothing."""
    burn_in = max(scenario.burn_in, min(1, scenario.max_steps - 1)) if chosen is None else chosen
    if not 0 <= burn_in < scenario.max_steps:
        raise ValueError(
            f"burn_in must be less than the {scenario.max_steps} steps of a run of {scenario.name!r}; got {burn_in}"
        )
    return int(burn_in)


def _listed(value: Any) -> list[Any]:
    return [value] if isinstance(value, (str, Mapping, Spec)) or not isinstance(value, Sequence) else list(value)


def _distinct(kind: str, labels: Sequence[str]) -> None:
    if not labels:
        raise ValueError(f"name at least one {kind}")
    twice = next((label for label in labels if labels.count(label) > 1), None)
    if twice is not None:
        raise ValueError(f"{kind} {twice!r} is named twice; give each once, with different options if need be")


def _estimators(
    scenario: Scenario, chosen: Sequence[Any] | None, options: Mapping[str, Mapping[str, Any]]
) -> tuple[Spec, ...]:
    chosen = list(scenario.estimators or DEFAULT_ESTIMATORS) if chosen is None else _listed(chosen)
    specs = [Spec.parse(item) for item in chosen]
    _distinct("estimator", [spec.label for spec in specs])
    return tuple(Spec(s.label, s.name, {**options.get(s.name, {}), **s.options}) for s in specs)


def _policies(scenario: Scenario, chosen: Sequence[Any] | None) -> list[Spec]:
    if chosen is None:
        return [Spec(scenario.policy.name, scenario.policy.name, dict(scenario.policy.options))]
    specs = [policies.parse(item) for item in _listed(chosen)]
    _distinct("policy", [spec.label for spec in specs])
    return specs


def _driver(specs: Sequence[Spec], driver: str | None) -> int:
    labels = [spec.label for spec in specs]
    if driver is not None:
        if driver not in labels:
            raise ValueError(registry.unknown_name("driver (an estimator of the comparison)", driver, labels))
        return labels.index(driver)
    names = [spec.name for spec in specs]
    return next((names.index(name) for name in DRIVERS if name in names), 0)


def _try(scenario: Scenario, policy: Spec, estimators: Sequence[Spec]) -> str:
    """Build everything once, so that a wrong option is said before workers start; the policy's weights."""
    motion, sensor, target = scenario.models()
    for spec in estimators:
        registry.make(spec.name, motion, sensor, target, max_landmarks=scenario.max_landmarks, **spec.options)
    return policies.make(policy.name, policies.PolicyContext.from_scenario(scenario), **policy.options).weights


def run_seeds(seed: int, purpose: int, runs: Sequence[int] | Ints) -> Ints:
    """One seed per run, the same whatever else is compared: SeedSequence([seed, purpose, run]), 63 bits."""
    words = [np.random.SeedSequence([seed, purpose, int(run)]).generate_state(1, np.uint64)[0] >> 1 for run in runs]
    return np.array(words, dtype=np.int64)
