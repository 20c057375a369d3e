"""Wu and Sun 2013, experiment 3 and Figure 5: errors against the number of landmarks."""

from slam_gym.reproduce.experiment import Experiment, Outcome
from slam_gym.reproduce.slamto_sizes import Errors, outcome
from slam_gym.reproduce.slamto_world import NAMES, QUICK_RUNS, RUNS, SLAMTO, world
from slam_gym.reproduce.study import Study

LANDMARKS = (5, 10, 20, 40, 80, 120, 160)
QUICK_LANDMARKS = (5, 20, 80)
EKF = "ekf"


def run(study: Study) -> Outcome:
    """Worlds of more and more landmarks; the joint EKF beside SLAMTO, whose particles are what runs out."""
    sizes = QUICK_LANDMARKS if study.quick else LANDMARKS
    errors: dict[str, Errors] = {label: {name: [] for name in NAMES} for label in (SLAMTO, EKF)}
    for size in sizes:
        sample = study.measure(
            f"{size} landmarks", world(size), [SLAMTO, EKF], runs=study.size(RUNS, QUICK_RUNS), driver=SLAMTO,
            fields=tuple(NAMES),
        )  # fmt: skip
        for label, lines in errors.items():
            for name in NAMES:
                lines[name].append(sample.of_runs(label, name))
    return outcome(sizes, errors[SLAMTO], "landmarks", {EKF: errors[EKF]})


EXPERIMENT = Experiment(
    "slamto-3", "wu-2013", "Experiment 3 and Figure 5", "errors against the number of landmarks", run
)
