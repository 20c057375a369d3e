"""Wu and Sun 2013, experiment 2 and Figure 4: errors against the number of particles."""

from slam_gym.reproduce.experiment import Experiment, Outcome
from slam_gym.reproduce.slamto_sizes import outcome
from slam_gym.reproduce.slamto_world import NAMES, QUICK_RUNS, RUNS, SLAMTO, world
from slam_gym.reproduce.study import Study

PARTICLES = (5, 10, 20, 50, 100, 200, 500, 1000, 2000)
QUICK_PARTICLES = (5, 20, 50, 200, 500)


def run(study: Study) -> Outcome:
    """All numbers of particles, and FastSLAM 2's proposal beside them, on the same data."""
    sizes = QUICK_PARTICLES if study.quick else PARTICLES
    labels = {kind: [f"{kind}:particles={size}" for size in sizes] for kind in ("slamto", "fastslam2")}
    sample = study.measure(
        "particles", world(), [*labels["slamto"], *labels["fastslam2"]], runs=study.size(RUNS, QUICK_RUNS),
        driver=SLAMTO, fields=tuple(NAMES),
    )  # fmt: skip
    errors = {kind: {name: [sample.of_runs(label, name) for label in names] for name in NAMES}
              for kind, names in labels.items()}  # fmt: skip
    return outcome(sizes, errors["slamto"], "particles", {"fastslam2": errors["fastslam2"]})


EXPERIMENT = Experiment(
    "slamto-2", "wu-2013", "Experiment 2 and Figure 4", "errors against the number of particles", run
)
