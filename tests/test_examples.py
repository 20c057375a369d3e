"""Every example runs, small, as a user would start it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.py"))
SMALL = {
    "01_first_episode": ("30",),
    "02_compare_estimators": ("2", "30"),
    "03_own_policy": ("2", "30"),
    "04_vector_env": ("4", "30"),
    "05_own_estimator": ("2", "30"),
    "06_train_ppo": ("512", "4"),
    "07_ppo_in_one_file": ("--lanes", "8", "--rollout", "16", "--decisions", "256", "--batch", "64"),
    "08_which_filter_pilots_best": ("2", "30"),
    "09_how_soon_without_knowing": ("12", "4", "40"),
}
SAYS = {
    "01_first_episode": "pursuit",
    "02_compare_estimators": "Paired differences",
    "03_own_policy": "orbit:radius=1.5",
    "04_vector_env": "finite: True",
    "05_own_estimator": "frozen-map",
    "06_train_ppo": "decisions per second",
    "07_ppo_in_one_file": "256 decisions, reward",
    "08_which_filter_pilots_best": "ekf against ri-ekf: target RMSE",
    "09_how_soon_without_knowing": "bound without knowing",
}
NEEDS = {"06_train_ppo": "stable_baselines3", "07_ppo_in_one_file": "torch"}
LINES = {"07_ppo_in_one_file": 150}  # one file is its point


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(example, tmp_path):
    if example.stem in NEEDS:
        pytest.importorskip(NEEDS[example.stem])
    environment = {**os.environ, "SDL_VIDEODRIVER": "dummy", "PYTHONWARNINGS": "error::RuntimeWarning"}
    done = subprocess.run(
        [sys.executable, str(example), *SMALL[example.stem]],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert SAYS[example.stem] in done.stdout
    assert not list(tmp_path.iterdir()), "an example leaves nothing behind"


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_short(example):
    assert len(example.read_text().splitlines()) < LINES.get(example.stem, 80)
