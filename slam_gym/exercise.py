"""A few made-up sweeps for an estimator alone: its kernels are compiled, while another process compiles the world's."""

import numpy as np

from estimators import registry
from estimators.interface import TARGET, UNKNOWN, Scan, TruthAware
from slam_gym.scenario import Scenario
from slam_gym.simulation import make_estimator
from slam_gym.specs import Spec

STEPS = 4
RETURNS = ((2.0, 0.1, TARGET), (3.0, -0.3, 0), (4.0, 0.4, 1))  # (range [m], bearing [rad], label)


def exercise(scenario: Scenario, spec: Spec) -> None:
    """Predict and update with the scenario's models, and look at the belief.

    Reference filters are left out: what they are told comes from a world.
    """
    if issubclass(registry.get(spec.name), TruthAware):
        return
    estimator = make_estimator(scenario, spec.name, spec.options, 1)
    estimator.reset(np.zeros((1, 3)), np.zeros((1, 3, 3)), seeds=np.zeros(1, dtype=np.int64))
    for step in range(STEPS):
        estimator.predict(np.array([[0.5, 0.1]]), float(scenario.dt))
        estimator.update(_sweep(step, scenario))
        estimator.belief.refresh()


def _sweep(step: int, scenario: Scenario) -> Scan:
    """What is there to be seen in the scenario, the target or landmarks, a little further off at each step."""
    known = scenario.models()[2] is not None
    returns = [one for one in RETURNS if (known if one[2] == TARGET else one[2] < scenario.max_landmarks)]
    scan = Scan.empty(1, max(1, len(returns)))
    for i, (r, bearing, label) in enumerate(returns):
        scan.ranges[0, i], scan.bearings[0, i] = r + 0.1 * step, bearing
        scan.labels[0, i] = label if scenario.landmarks.labelled or label == TARGET else UNKNOWN
    scan.count[0] = len(returns)
    return scan
