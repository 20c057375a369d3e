"""Tian et al. 2010, Figures 3, 4 and 7 and the left half of Table 1: a loop past 35 landmarks."""

from slam_gym.reproduce.cdkf_batches import loop, measure_batches, published_landmarks
from slam_gym.reproduce.cdkf_loop import outcome
from slam_gym.reproduce.experiment import Choice, Experiment, Outcome
from slam_gym.reproduce.study import Study

SHARES = ("72.41", "0")


def run(study: Study) -> Outcome:
    """Batches of 45 runs past the map's 35 landmarks."""
    scenario = loop(study, "tian-sparse", published_landmarks(study))
    taken = "the published web map (--webmap)" if study.webmap else "the preset's map of the same size and density"
    why = "the paper shows its map only as a picture; this one gives its 8,779 steps" if study.webmap else (
        "the published map does not come with slam-gym; name its folder with --webmap"
    )  # fmt: skip
    batches = measure_batches(study, lambda _: scenario)
    return outcome(batches, scenario, SHARES, Choice("map", taken, why))


EXPERIMENT = Experiment(
    "cdkf-sparse", "tian-2010", "Figures 3, 4, 7 and Table 1 (35 landmarks)",
    "CDKF against FastSLAM 2.0 in a loop past 35 landmarks: error, time, NEES", run,
)  # fmt: skip
