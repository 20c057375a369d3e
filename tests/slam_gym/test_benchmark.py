"""What the benchmark compares does the same work."""

from pathlib import Path

import numpy as np
import pytest

from slam_gym.benchmark import decisions, drives, foreign, measure, page, scaling, stream, textbook, timing
from slam_gym.cli import main

SECTIONS = [
    "## A step of the environment", "## A step of a filter", "## Against BLAS", "## A decision of a policy",
    "## Growth",
]  # fmt: skip
WHOLE = [*SECTIONS[:-1], "## Training", SECTIONS[-1]]  # where Stable-Baselines3 is installed, and time taken


@pytest.fixture(scope="module")
def drive():
    return stream.make_stream(12)


@pytest.fixture(scope="module")
def ours(drive):
    """The joint EKF's mean after each step."""
    estimator, means = stream.settled("ekf", drive), []
    for sweep in drive.rest:
        estimator.predict(np.array([sweep.control]), stream.DT)
        estimator.update(sweep.scan())
        means.append(estimator.joint(0)[0])
    return np.array(means)


@pytest.mark.parametrize(("package", "name"), [("filterpy", "FilterPyEKF"), ("stonesoup", "StoneSoupEKF")])
def test_a_foreign_filter_believes_the_same(package, name, drive, ours):
    pytest.importorskip(package)
    other = getattr(foreign, name)(stream.settled("ekf", drive))
    for k, sweep in enumerate(drive.rest):
        other.step(sweep)
        np.testing.assert_allclose(other.mean, ours[k], atol=1e-9)


def test_the_textbook_jacobians_are_derivatives():
    rng = np.random.default_rng(1)
    x = np.append(rng.standard_normal(7), rng.uniform(2, 5, 4))
    control, step = (0.5, 0.3), 1e-6
    for j in (3, 9):
        numeric = [(textbook.expected(x + d, j) - textbook.expected(x - d, j)) / (2 * step) for d in step * np.eye(11)]
        np.testing.assert_allclose(textbook.return_jacobian(x, j), np.transpose(numeric), atol=1e-8)
    numeric = [
        (textbook.moved(x + d, control) - textbook.moved(x - d, control)) / (2 * step) for d in step * np.eye(11)
    ]
    np.testing.assert_allclose(textbook.motion_jacobian(x, control), np.transpose(numeric), atol=1e-8)


def test_interleaved_times_rank_works_by_their_cost():
    numbers = np.ones(200_000)
    works = {"little": lambda: numbers[:2000].sum(), "much": lambda: numbers.sum()}
    found = timing.least_seconds(works, rounds=5, slice_seconds=0.002)
    assert 0.0 < found["little"] < found["much"]


@pytest.mark.parametrize("spec", ["ri-ekf", "cdkf:budget=10", "fastslam2:particles=20"])
def test_a_replayed_drive_is_the_drive(spec):
    """By bound kernels or by methods, part by part, again and again: what `Episode` gives the same estimator."""
    steps = drives.PART + 20
    drive = drives.record_drive("tian-sparse", seed=3, longest=steps)
    replay = drives.Replay(spec, drive)
    plain = drives.Replay(spec, drive).estimator
    for _ in range(2):
        replay.begin()
        for part in replay.parts:
            part()
    plain.reset(drive.start, drive.start_cov, seeds=0)
    for control, sweep in zip(drive.controls, drive.sweeps, strict=True):
        plain.predict(control, drive.scenario.dt)
        if sweep is not None:
            plain.update(sweep)
    assert sum(sweep is not None for sweep in drive.sweeps) == steps // 8
    replay.estimator.belief.mark_stale()
    np.testing.assert_array_equal(replay.estimator.belief.pose, plain.belief.pose)
    np.testing.assert_array_equal(replay.estimator.belief.landmark_cov, plain.belief.landmark_cov)


def test_exponent_of_a_power_law():
    sizes = [1, 10, 100, 1000]
    assert scaling.exponent(sizes, [3.0 * n**1.5 for n in sizes]) == pytest.approx(1.5)


@pytest.fixture(scope="module")
def found():
    """The smallest measurement of everything."""
    tiny = measure.Size(
        rounds=1, lanes=(1, 2), compared_lanes=(1,), landmarks=(10, 20), particles=(10, 20), blas_landmarks=(10,),
        compressed_landmarks=(10,), gaussian=("ekf",), scaled=("ekf",), particle=("fastslam2",), others=False,
        training=False, drives=("geng-hu",), drive_steps=20, stored_landmarks=(20,),
        policies=("pursuit", "not-installed"), decision_runs=2, decision_lanes=3, decision_steps=10,
    )  # fmt: skip
    told = []
    result = measure.measure(tiny, lambda what, done, total: told.append((done, total)))
    assert told[-1][0] == told[-1][1] == max(done for done, _ in told)
    return result


def test_the_page_has_every_table(found):
    text = page.page(found, "slam-gym benchmark")
    assert [line for line in text.splitlines() if line.startswith("## ")] == SECTIONS
    for name in ("clean NumPy", "gym.make", "CartPole", "`ekf`, us", "`compressed-ekf`, us", "exponent",
                 "geng-hu, `ri-ekf`: a control step", "200 particles, 20 landmarks", "| `pursuit` |",
                 "lane of 3"):  # fmt: skip
        assert name in text


def test_only_what_is_asked_for_is_measured():
    size = measure.Size(policies=("pursuit-hunt",), decision_runs=1, decision_lanes=2, decision_steps=30)
    found = measure.measure(size, lambda *_: None, ["decisions"])
    text = page.page(found, "slam-gym benchmark --only decisions")
    assert [line for line in text.splitlines() if line.startswith("## ")] == ["## A decision of a policy"]
    row = found["decisions"][0]
    assert 0.0 < row["mean"] <= row["slowest"] <= row["longest"]
    assert 0.0 < row["lane_mean"] <= row["lane_longest"]


def test_a_policy_decides_the_same_whenever_it_is_timed():
    """Only then may the least of several times be taken for each decision."""
    driver = decisions.Driver("pursuit-hunt:lost_std=0.01", 2)
    drives_ = []
    for _ in range(2):
        assert driver.seconds(np.array([3, 4]), 12).shape == (12,)
        drives_.append((driver.simulation.world.pose.copy(), driver.policy.command.copy()))
    np.testing.assert_array_equal(*(pose for pose, _ in drives_))
    np.testing.assert_array_equal(*(command for _, command in drives_))


def test_the_committed_page_is_of_this_shape():
    text = (Path(__file__).parents[2] / "BENCHMARKS.md").read_text()
    assert text.startswith(page.HEAD)
    assert [line for line in text.splitlines() if line.startswith("## ")] == WHOLE
    for name in ("FilterPy", "Stone Soup", "iSAM2", "gym.make_vec, 256 lanes", "SyncVectorEnv", "AsyncVectorEnv"):
        assert name in text


def test_benchmark_says_where_it_cannot_write(tmp_path, capsys):
    assert main(["benchmark", "--quick", "--write", str(tmp_path / "missing" / "page.md")]) == 2
    assert "no folder" in capsys.readouterr().err


def test_doctor_names_versions_and_cache(capsys):
    assert main(["doctor", "--no-speed"]) == 0
    told = capsys.readouterr().out
    for word in ("numba", "gymnasium", "processor", "kernel cache", "writable"):
        assert word in told


def test_warmup_compiles_and_refuses_unknown_names(capsys):
    assert main(["warmup", "dead-reckoning"]) == 0
    assert "1 compiled" in capsys.readouterr().out
    assert main(["warmup", "ekff"]) == 2
    assert "Did you mean 'ekf'" in capsys.readouterr().err
