import errno
import json

import numpy as np
import pandas as pd
import pytest

from slam_gym import tables
from slam_gym.records import FIELDS, LANDMARK, TRACK, Records
from slam_gym.results import Results, file_stem, write_atomic, write_json

KEY = ("field", "pursuit", "ekf")


def records(runs=4, steps=50, *, scale=1.0, seed=0, first=0):
    rng = np.random.default_rng(seed)
    values = scale * np.abs(rng.standard_normal((runs, steps, len(FIELDS))))
    values[:, :, FIELDS.index("landmark_count")] = 7.0
    index = np.arange(first, first + runs)
    track = np.zeros((steps, len(TRACK)))
    track[:, 0], track[:, 1], track[:, 2] = first, np.arange(1, steps + 1), 0.1 * np.arange(1, steps + 1)
    track[:, TRACK.index("heading")] = 0.5
    track[:, TRACK.index("target_x")] = np.nan
    landmarks = np.ones((3, len(LANDMARK)))
    landmarks[:, 0] = first
    return Records(
        run=index,
        seed=index + 100,
        steps=np.full(runs, steps),
        values=values,
        age=np.tile(0.1 * np.arange(steps), (runs, 1)),
        time=0.1 * np.arange(1, steps + 1),
        collisions=np.zeros(runs, dtype=np.int64),
        effort=np.full(runs, 0.25),
        counts={"gated": np.arange(runs)},
        timing=np.array([1e-3, 1000.0, 3e-3, 1000.0]),
        tracks=track,
        landmarks=landmarks,
    )


def tabulated(*each, burn_in=0):
    """Results of one scenario and policy, (name, records) per estimator."""
    keys = [("field", "pursuit", name) for name, _ in each]
    runs = [tables.run_table(key, r, burn_in=burn_in) for key, (_, r) in zip(keys, each, strict=True)]
    rows = [tables.summary_row(key, r, t, burn_in=burn_in) for key, (_, r), t in zip(keys, each, runs, strict=True)]
    return pd.concat(runs, ignore_index=True), pd.DataFrame(rows)


@pytest.fixture
def results(tmp_path):
    a, b = records(), records(seed=1)
    runs, summary = tabulated(("ekf", a), ("ri-ekf", b))
    return Results(
        path=tmp_path / "out",
        config={"command": "slam-gym compare", "limit": np.inf, "seed": np.int64(3)},
        runs=runs,
        summary=summary,
        paired=tables.paired_table(runs),
        series=tables.series_table(KEY, a),
        tracks=tables.track_table(KEY, a),
        landmarks=tables.landmark_table(KEY, a),
    )


def test_a_folder_loads_as_it_was_saved(results):
    results.save()
    again = Results.load(results.path)
    for name in ("runs", "summary", "series", "tracks", "landmarks"):
        pd.testing.assert_frame_equal(getattr(again, name), getattr(results, name))
    pd.testing.assert_frame_equal(again.paired, results.paired)
    assert again.config == {"command": "slam-gym compare", "limit": "inf", "seed": 3}
    assert sorted(p.name for p in results.path.iterdir()) == sorted(
        ["config.json", "paired.csv", "trajectories"]
        + [f"{name}.parquet" for name in ("runs", "summary", "series", "tracks", "landmarks")]
        + ["runs.csv", "summary.csv"]
    )
    csv = pd.read_csv(results.path / "summary.csv")
    np.testing.assert_allclose(csv["robot_error_rmse"], results.summary["robot_error_rmse"])


def test_trajectories_are_tum_lines_with_unit_quaternions(results):
    results.save()
    files = {path.name: np.loadtxt(path) for path in (results.path / "trajectories").iterdir()}
    assert sorted(files) == [
        "field-pursuit-run-0000-ekf-target-truth.tum",
        "field-pursuit-run-0000-ekf-truth.tum",
        "field-pursuit-run-0000-ekf.tum",
    ]  # no believed target: it was never known
    table = files["field-pursuit-run-0000-ekf.tum"]
    assert table.shape == (50, 8)
    np.testing.assert_allclose(2.0 * np.arctan2(table[:, 6], table[:, 7]), 0.5, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(table[:, 4:], axis=1), 1.0)


def test_a_run_is_summarised_by_the_textbook():
    r = records()
    runs, summary = tabulated(("ekf", r), burn_in=10)
    error = r["robot_error"][:, 10:]
    np.testing.assert_allclose(runs["robot_error_mean"], error.mean(axis=1))
    np.testing.assert_allclose(runs["robot_error_rmse"], np.sqrt((error**2).mean(axis=1)))
    row = summary.iloc[0]
    assert row["robot_error_rmse"] == pytest.approx(np.sqrt((error**2).mean()))
    assert row["robot_error_mean_sd"] == pytest.approx(error.mean(axis=1).std(ddof=1))
    assert row["pose_nees_mean"] == pytest.approx(r["pose_nees"][:, 10:].mean())
    assert row["pose_nees_median"] == pytest.approx(np.median(r["pose_nees"][:, 10:]))
    assert (row["predict_us"], row["update_us"]) == (pytest.approx(1.0), pytest.approx(3.0))
    assert row["lost_share"] == pytest.approx(np.mean(r.age[:, 10:] > 2.0))
    assert row["lost_end"] == 1.0
    bounded = {name.split("_nees")[0] for name in runs if name.endswith("_nees_in95_run")}
    assert bounded == {"pose", "target", "target_state"}  # no bounds hold for the mean over a map
    assert list(runs["count_gated"]) == [0, 1, 2, 3]
    recent = r.age[:, 10:] < 2.0
    expected = np.sqrt((r["target_error"][:, 10:][recent] ** 2).mean())
    assert row["target_error_lt2"] == pytest.approx(expected)
    assert np.isnan(row["target_error_gt15"])


def test_the_time_to_find_is_that_of_the_first_return():
    r = records(runs=3)
    r.age[:] = r.time  # no return: it counts from the start
    r.age[0, 20:] = 0.0
    r.age[1, 7:] = r.time[7:] - r.time[7]  # seen once, in the eighth step
    runs, summary = tabulated(("ekf", r))
    np.testing.assert_allclose(runs["find_time"], [2.1, 0.8, 5.0])  # never: the run's length
    assert list(runs["never_found"]) == [0.0, 0.0, 1.0]
    assert summary["never_found"][0] == pytest.approx(1.0 / 3.0)
    r.age[:] = np.nan  # a world without a target
    assert tabulated(("ekf", r))[0]["find_time"].isna().all()


def test_diverged_runs_are_counted_and_stay_in_the_averages():
    r = records()
    r.values[2, :, FIELDS.index("pose_nees")] = 1e6
    r.values[2, 30:, FIELDS.index("robot_error")] = np.inf
    runs, summary = tabulated(("ekf", r))
    assert list(runs["diverged"]) == [False, False, True, False]
    assert (summary["diverged"][0], summary["n_runs"][0]) == (1, 4)
    assert summary["robot_error_rmse"][0] == np.inf
    assert summary["pose_nees_mean"][0] > 1e5


def test_runs_of_unequal_length_end_where_they_end():
    a, b = records(2, 50), records(1, 30, first=2)
    joined = Records.join([b, a])
    assert list(joined.run) == [0, 1, 2]
    assert joined["robot_error"].shape == (3, 50)
    assert np.isnan(joined["robot_error"][2, 30:]).all()
    runs, _ = tabulated(("ekf", joined))
    assert runs["robot_error_end"][2] == b["robot_error"][0, -1]
    series = tables.series_table(KEY, joined)
    assert list(series["runs"].iloc[[0, 29, 30]]) == [3, 3, 2]
    assert not runs["diverged"].any()


def test_records_keep_every_bit_through_a_file(tmp_path):
    r = records()
    np.savez(tmp_path / "part.npz", **r.to_arrays("0"), **records(seed=9).to_arrays("1"))
    with np.load(tmp_path / "part.npz") as arrays:
        again = Records.from_arrays(arrays, "0")
    assert all((again.to_arrays("x")[k] == v).all() or np.isnan(v).any() for k, v in r.to_arrays("x").items())
    assert again.values.tobytes() == r.values.tobytes()
    kept = again.select({1, 3})
    assert list(kept.run) == [1, 3]
    assert kept.values.tobytes() == r.values[[1, 3]].tobytes()
    assert not len(kept.tracks)


def test_paired_differences_are_said_in_words():
    base, better = records(runs=20), records(runs=20)
    better.values[:, :, FIELDS.index("robot_error")] *= 0.5
    runs, _ = tabulated(("ekf", base), ("ri-ekf", better))
    paired = tables.paired_table(runs)
    row = paired[paired["metric"] == "robot_error_rmse"].iloc[0]
    assert row["baseline"] == "ekf"
    assert row["difference"] < 0 and row["high"] < 0 and row["n"] == 20
    assert row["sentence"].startswith("ri-ekf against ekf: robot RMSE 0.")
    assert "m lower (95 % CI 0." in row["sentence"]
    same = paired[paired["metric"] == "target_error_rmse"].iloc[0]
    assert "target RMSE no different" in same["sentence"]
    assert "lost_share" not in set(paired["metric"])  # shared data: the same for both


def test_policies_are_compared_as_estimators_are():
    far = tables.run_table(("field", "random", "ekf"), records(runs=9, scale=3.0, seed=5))
    near = tables.run_table(KEY, records(runs=9))
    paired = tables.paired_table(pd.concat([near, far]))
    assert set(paired["baseline"]) == {"policy pursuit"}
    assert paired["sentence"].iloc[0].startswith("ekf under policy random against policy pursuit: robot RMSE")
    one = tables.paired_table(tables.run_table(KEY, records()))
    assert list(one.columns) == list(paired.columns) and not len(one)


def test_missing_and_unfinished_folders_say_what_to_do(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no results folder .*slam-gym compare --out"):
        Results.load(tmp_path / "nothing")
    with pytest.raises(FileNotFoundError, match=r"holds no finished results .*--resume"):
        Results.load(tmp_path)


def test_a_full_disk_is_one_clear_error_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")

    def full(file):
        file.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(
        OSError, match=r"cannot write '.*table.csv': No space left on device. What was written.*--resume"
    ):
        write_atomic(path, full)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]


def test_an_unwritable_place_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"cannot write .*config.json"):
        write_json(tmp_path / "file" / "config.json", {})


def test_json_is_strict_and_names_are_safe(tmp_path):
    write_json(tmp_path / "a.json", {"a": np.float64(np.nan), "b": (1, np.bool_(True)), "c": tmp_path})
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": "nan", "b": [1, True], "c": str(tmp_path)}
    assert file_stem("compare", "slamto:particles=200", "a/b") == "compare-slamto-particles=200-a-b"
