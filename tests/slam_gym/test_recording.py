import numpy as np
import pytest

from estimators.interface import TARGET, UNKNOWN
from slam_gym import log_format
from slam_gym.recording import Recording, Track
from slam_gym.schedule import make_schedule

ODOMETRY = [[10.0, 0.5, 0.0], [11.0, 0.5, 0.4], [13.0, 0.0, 0.0]]
MEASUREMENTS = [[10.5, 3, 2.0, 0.1], [10.5, TARGET, 1.0, -0.2], [12.0, UNKNOWN, 3.0, 0.3], [12.5, 3, 2.5, 0.0]]
TRUTH = [[10.0, 0.0, 0.0, 3.0], [12.0, 1.0, 2.0, -3.0], [13.0, 1.0, 3.0, -3.0]]


def tables(**changes):
    return {"odometry": ODOMETRY, "measurements": MEASUREMENTS, "truth": TRUTH, "landmarks": [[3, 5.0, 6.0]]} | changes


def test_rows_of_one_time_are_one_sweep():
    recording = Recording.from_tables("r", tables())
    assert recording.sweep_times.tolist() == [0.5, 2.0, 2.5]
    assert recording.sweep_first.tolist() == [0, 2, 3, 4]
    assert recording.labels.tolist() == [3, TARGET, UNKNOWN, 3]
    assert recording.widest_sweep == 2
    assert recording.time_origin == 10.0
    assert not recording.complete


def test_sweeps_without_returns_count_when_all_sweeps_are_listed():
    recording = Recording.from_tables("r", tables(sweeps=[10.0, 10.5, 11.0, 12.0, 12.5]))
    assert recording.complete
    assert np.diff(recording.sweep_first).tolist() == [0, 2, 0, 1, 1]


def test_commands_are_held_and_delayed():
    recording = Recording.from_tables("r", tables())
    when = np.array([-1.0, 0.0, 0.5, 1.5, 3.0, 9.0])
    moved = recording.distance_and_turn(when)
    np.testing.assert_allclose(moved[:, 0], [0.0, 0.0, 0.25, 0.75, 1.5, 1.5], atol=1e-12)
    np.testing.assert_allclose(moved[:, 1], [0.0, 0.0, 0.0, 0.2, 0.8, 0.8], atol=1e-12)
    np.testing.assert_allclose(recording.distance_and_turn(when + 0.2, delay=0.2), moved, atol=1e-12)


def test_headings_turn_through_the_shorter_arc():
    track = Track(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 3.0], [1.0, 2.0, -3.0]]))
    found = track.at([0.0, 0.25, 0.75, 1.25])
    np.testing.assert_allclose(found[:2, :2], [[0.0, 0.0], [0.25, 0.5]], atol=1e-12)
    arc = 2 * np.pi - 6.0
    assert found[1, 2] == pytest.approx(3.0 + 0.25 * arc)
    assert found[2, 2] == pytest.approx(-3.0 - 0.25 * arc)
    assert np.isnan(found[3]).all()


def test_a_heading_that_was_not_recorded_touches_no_other():
    track = Track(np.arange(4.0), np.array([[0.0, 0.0, 3.0], [0.0, 0.0, np.nan], [0.0, 0.0, -3.0], [0.0, 0.0, -2.0]]))
    np.testing.assert_allclose(track.at([0.0, 1.0, 2.0, 2.5])[:, 2], [3.0, np.nan, -3.0, -2.5], atol=1e-12)


def test_truth_is_not_interpolated_across_a_gap():
    track = Track(np.array([0.0, 0.5, 5.0, 5.5]), np.zeros((4, 3)))
    assert np.isnan(track.at([0.25, 2.0, 5.25])[:, 0]).tolist() == [False, True, False]


def test_velocity_is_a_mean_over_a_second():
    times = np.arange(0.0, 5.0, 0.1)
    track = Track(times, np.column_stack([0.3 * times, -0.1 * times, np.zeros_like(times)]))
    np.testing.assert_allclose(track.velocity_at([0.0, 2.03, 4.9]), np.tile([0.3, -0.1], (3, 1)), atol=1e-12)


def test_a_few_stray_rows_are_sorted_and_counted():
    odometry = np.column_stack([np.arange(200.0), np.full(200, 0.1), np.zeros(200)])
    odometry[50, 0], odometry[120, 0] = 48.5, 119.0
    recording = Recording.from_tables("r", tables(odometry=odometry))
    assert (np.diff(recording.command_times) > 0).all()
    assert recording.warnings == {
        "odometry: rows out of order, sorted": 1,
        "odometry: rows at the same time, the last kept": 1,
    }


def test_impossible_returns_are_dropped_and_counted():
    rows = [*MEASUREMENTS, [12.5, 4, -1.0, 0.0], [12.5, 3, 2.0, 0.0], [12.6, -7, 1.0, 0.0]]
    recording = Recording.from_tables("r", tables(measurements=rows))
    assert len(recording.ranges) == 4
    assert sorted(recording.warnings.values()) == [1, 2]


def test_times_in_milliseconds_are_noticed():
    times = np.arange(0.0, 60_000.0, 100.0)
    paths = {"truth": np.column_stack([times, times, times, 0 * times]), "measurements": [[100.0, 1, 2.0, 0.0]]}
    recording = Recording.from_tables("r", tables(odometry=np.column_stack([times, times, times]), **paths))
    assert "odometry: rows over 10 s apart (times are in seconds)" in recording.warnings
    with pytest.raises(ValueError, match=r"the truth's rows are 100 s or more apart.* times are in seconds"):
        make_schedule(recording)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"odometry": [[0.0, 1.0]]}, r"odometry: expected 3 columns \(time, speed, turn_rate\); found 2"),
        ({"odometry": []}, "holds no commands"),
        ({"odometry": [[2.0, 0, 0], [1.0, 0, 0]]}, "must not run backwards; row 2 is at 1 s after 2 s"),
        ({"truth": [[0.0, 1.0, np.nan, 0.0]]}, "truth: row 1 holds a number that is not finite"),
        (
            {"measurements": [[0.0, 1, 2.0, -31.5], [0.0, 2, 2.0, 1.0]]},
            "in radians.* 1 of 2 .* at 31.5. Degrees",
        ),
        ({"imu": [[0.0]]}, "unknown table 'imu'; a recording has odometry"),
    ],
)
def test_wrong_tables_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Recording.from_tables("r", tables(**changes))
    with pytest.raises(ValueError, match="measurements is missing"):
        Recording.from_tables("r", {"odometry": ODOMETRY})


@pytest.mark.parametrize("name", ["log", "log.npz"])
def test_a_log_comes_back_as_it_was_written(tmp_path, name):
    extra = {"target": [[10.0, 1.0, 2.0], [13.0, 1.0, 2.5]], "sweeps": [10.5, 11.5, 12.0, 12.5]}
    recording = Recording.from_tables("log", tables(**extra))
    again = log_format.load(log_format.save(tmp_path / name, recording))
    for table, rows in log_format.tables_of(recording).items():
        np.testing.assert_array_equal(log_format.tables_of(again)[table], rows)
    assert again.complete and again.time_origin == 10.0


def test_columns_come_in_any_order_and_labels_as_words(tmp_path):
    (tmp_path / "odometry.csv").write_text("turn_rate,time,speed\n0.1,0.0,0.5\n")
    (tmp_path / "measurements.csv").write_text(
        "# my robot\ntime, label, range, bearing\n0.5, target, 2, 0\n0.5, unknown, 3, 0\n0.5, 7, 3, 1\n"
    )
    recording = log_format.load(tmp_path)
    assert recording.commands.tolist() == [[0.5, 0.1]]
    assert recording.labels.tolist() == [TARGET, UNKNOWN, 7]
    assert recording.truth is None and recording.target is None


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("odometry.csv", "time,v,w\n0,1,2\n", "odometry.csv: expected a first line with the columns time, speed"),
        ("odometry.csv", "", "odometry.csv: expected a first line with the columns .* found nothing"),
        (
            "measurements.csv",
            "time,label,range,bearing\n0,door,1,2\n",
            "measurements.csv: row 1 must hold 4 numbers .*, or as a label 'target' or 'unknown'; got 0, door",
        ),
        ("odometry.csv", "time;speed;turn_rate\n0;1;2\n", "columns are separated by commas"),
        ("odometry.csv", "time,speed,turn_rate\n0,1\n", "odometry.csv: row 1 must hold 3 numbers"),
    ],
)
def test_foreign_files_are_refused(tmp_path, file, text, message):
    log_format.save(tmp_path, Recording.from_tables("log", tables()))
    (tmp_path / file).write_text(text)
    with pytest.raises(ValueError, match=message):
        log_format.load(tmp_path)


def test_missing_logs_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no log .*nothing"):
        log_format.load(tmp_path / "nothing")
    with pytest.raises(FileNotFoundError, match=r"lacks odometry.csv and measurements.csv"):
        log_format.load(tmp_path)
    (tmp_path / "x.npz").write_text("no archive")
    with pytest.raises(ValueError, match=r"x.npz is no NPZ file"):
        log_format.load(tmp_path / "x.npz")
