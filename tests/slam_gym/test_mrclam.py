import gzip
from pathlib import Path

import numpy as np
import pytest

from estimators.interface import TARGET
from slam_gym import mrclam

SET_7 = Path(__file__).resolve().parents[2] / "../shared/data/mrclam/MRCLAM_Dataset7"
BARCODES = [[1, 5], [2, 14], [3, 41], [6, 63], [7, 25]]
LANDMARKS = [[6, 1.0, 2.0, 0.0, 0.0], [7, -1.0, 2.0, 0.0, 0.0]]


def files(**changes):
    times = np.arange(0.0, 10.0, 0.1) + 1.2e9
    path = np.column_stack([times, 0.05 * np.arange(100), np.zeros(100), np.zeros(100)])
    found = {"Barcodes": BARCODES, "Landmark_Groundtruth": LANDMARKS}
    for robot in (1, 2, 3):
        found[f"Robot{robot}_Odometry"] = np.column_stack([times, np.full(100, 0.5), np.zeros(100)])
        found[f"Robot{robot}_Groundtruth"] = path
        found[f"Robot{robot}_Measurement"] = np.zeros((0, 4))
    rows = [[1.0, 63, 2.0, 0.5], [1.001, 14, 1.0, 0.1], [1.002, 41, 1.5, 0.2], [2.0, 25, 2.0, 0.5], [2.5, 99, 3.0, 0.0]]
    found["Robot1_Measurement"] = np.array(rows) + np.array([1.2e9, 0, 0, 0])
    return found | changes


@pytest.mark.parametrize("compress", [False, True])
def test_barcodes_become_landmarks_and_the_target(tmp_path, compress):
    mrclam.save(tmp_path, files(), compress=compress)
    recording = mrclam.load(tmp_path, 1, 2)
    assert recording.name == "mrclam robot 1 target 2"
    assert recording.labels.tolist() == [6, TARGET, 7]
    np.testing.assert_allclose(recording.sweep_times, [1.0, 2.0], atol=1e-6)  # a millisecond apart: one sweep
    assert recording.landmark_ids.tolist() == [6, 7]
    assert recording.warnings == {
        "Robot1_Measurement.dat: unknown barcodes, left out": 1,
        "Robot1_Measurement.dat: sightings of other robots, left out": 1,
    }
    assert mrclam.robots(tmp_path) == [1, 2, 3]


def test_a_robot_that_saw_nothing_loads(tmp_path):
    recording = mrclam.load(mrclam.save(tmp_path, files()), 2, None)
    assert len(recording.sweep_times) == 0
    assert recording.target is None


@pytest.mark.parametrize(
    ("stem", "text", "message"),
    [
        ("Robot1_Odometry", "1 2 3 4\n", r"Robot1_Odometry.dat: expected 3 columns .*time, speed.*; found 4"),
        ("Robot1_Measurement", "1 63 x 4\n", "Robot1_Measurement.dat: expected 4 columns of numbers"),
        ("Robot1_Measurement", "1 6 2 0\n2 7 2 0\n", "barcodes are not in Barcodes.dat .*not subjects"),
        ("Robot2_Groundtruth", "3 1 1 0\n2 1 1 0\n1 1 1 0\n", "Robot2_Groundtruth.dat: times must not run backwards"),
    ],
)
def test_foreign_files_are_refused(tmp_path, stem, text, message):
    mrclam.save(tmp_path, files())
    (tmp_path / f"{stem}.dat").write_text("# Time\n" + text)
    with pytest.raises(ValueError, match=message):
        mrclam.load(tmp_path, 1, 2)


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="expected an unpacked MRCLAM data set"):
        mrclam.load(tmp_path / "no", 1, 2)
    with pytest.raises(FileNotFoundError, match=r"lacks Landmark_Groundtruth.dat \(plain or .gz\)"):
        mrclam.load(tmp_path, 1, 2)
    mrclam.save(tmp_path, files())
    (tmp_path / "Robot3_Odometry.dat").unlink()
    with pytest.raises(FileNotFoundError, match=r"lacks Robot3_Odometry.dat"):
        mrclam.load(tmp_path, 3, 2)
    with pytest.raises(ValueError, match=r"no target 6 in .*; its robots are 1, 2, 3"):
        mrclam.load(tmp_path, 1, 6)
    with pytest.raises(ValueError, match="must differ; both are 2"):
        mrclam.load(tmp_path, 2, 2)


def test_a_truncated_archive_is_refused(tmp_path):
    mrclam.save(tmp_path, files(), compress=True)
    whole = (tmp_path / "Robot1_Odometry.dat.gz").read_bytes()
    (tmp_path / "Robot1_Odometry.dat.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"Robot1_Odometry.dat.gz: expected 3 columns"):
        mrclam.load(tmp_path, 1, 2)
    (tmp_path / "Robot1_Odometry.dat.gz").write_bytes(gzip.compress(b"\xff\xfe"))
    with pytest.raises(ValueError, match=r"Robot1_Odometry.dat.gz: expected 3 columns"):
        mrclam.load(tmp_path, 1, 2)


@pytest.mark.skipif(not SET_7.is_dir(), reason="the data set is not here")
def test_the_published_set():
    recording = mrclam.load(SET_7, 3, 4)
    assert len(recording.landmark_ids) == 15
    assert recording.warnings["Robot3_Measurement.dat: unknown barcodes, left out"] == 9
    assert 880 < recording.sweep_times[-1] < 900
    assert np.abs(recording.bearings).max() < 0.6
