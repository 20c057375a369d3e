import re

import numpy as np
import pytest

from slam_gym.reproduce import catalogue
from slam_gym.reproduce.cdkf_batches import CDKF, EKF, FASTSLAM
from slam_gym.reproduce.cdkf_dense import draw_map
from slam_gym.reproduce.cdkf_memory import numbers_stored
from slam_gym.reproduce.experiment import PAPERS
from slam_gym.reproduce.rbpf_maps import STORES, drive_round
from slam_gym.reproduce.study import Study
from slam_gym.reproduce.verdict import FAILS, HOLDS, TIE
from slam_gym.scenario import Scenario
from slam_gym.scenario_io import read_columns


@pytest.mark.parametrize("name", catalogue.names())
def test_every_experiment_says_what_it_is(name):
    experiment = catalogue.get(name)
    assert experiment.name == name
    assert experiment.paper in PAPERS
    assert experiment.source and experiment.summary


def test_a_wrong_name_is_met_with_the_nearest():
    with pytest.raises(ValueError, match="Did you mean 'cdkf-sparse'"):
        catalogue.get("cdkf-spars")


@pytest.mark.parametrize(("landmarks", "cdkf", "ekf", "fastslam"), [(35, 902, 5402, 2220), (135, 1902, 74802, 8220)])
def test_the_memory_formulas(landmarks, cdkf, ekf, fastslam):
    assert numbers_stored(landmarks) == {CDKF: cdkf, EKF: ekf, FASTSLAM: fastslam}


def test_a_dense_map_fills_its_area(tmp_path):
    points = read_columns(str(draw_map(Scenario.load("tian-dense"), 3, tmp_path / "map.csv")), ("x_m", "y_m"))
    assert points.shape == (135, 2)
    assert (points >= (-140.0, -105.0)).all() and (points <= (110.0, 95.0)).all()
    assert (np.ptp(points, axis=0) > (230.0, 180.0)).all()


SLOW = ("slamto-1", "rbpf-proposal", "geng-nees")  # many estimators to compile


@pytest.mark.parametrize("name", ["slamto-table1", *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_a_tiny_run_is_complete(name, tmp_path):
    outcome = catalogue.get(name).run(Study(tmp_path, quick=True, most_runs=2, jobs=1))
    assert outcome.claims and outcome.choices and outcome.grids and outcome.drawings
    assert {claim.outcome for claim in outcome.claims} <= {HOLDS, FAILS, TIE}
    for claim in outcome.claims:
        assert re.search(r"\d", claim.ours) and claim.basis
    for grid in outcome.grids:
        assert all(len(row) == len(grid.columns) for row in grid.rows)
    assert not any("nan" in cell for grid in outcome.grids for row in grid.rows for cell in row)


def test_recorded_robots_need_a_recording(tmp_path):
    outcome = catalogue.get("slamto-robots").run(Study(tmp_path))
    assert not outcome.claims
    assert "--mrclam" in outcome.missing


def test_a_round_maps_every_landmark_and_the_storages_differ_in_bytes_alone():
    driven = drive_round(60, 20, 0)
    assert driven.mapped[-1] == 60
    assert set(driven.map_bytes) == set(STORES)
    assert driven.map_bytes["dense"][-1] == 60 * 20 * 5 * 8
    assert driven.megabytes("tree") < driven.megabytes("dense")
