"""Lazy columns and the tree against plain arrays, bit for bit."""

import numpy as np
import pytest

from estimators.particle import map_storage as store
from estimators.particle import tree_storage
from estimators.registry import make as make_estimator
from slam_gym.benchmark.maps import CONTROL, MOTION, SENSOR, sweeps

N, M = 12, 40


def resampling(rng, n):
    """Moves as `moves` makes them: survivors stay, their copies go to the places of the dead."""
    dead = rng.choice(n, rng.integers(0, n), replace=False)
    survivors = np.setdiff1d(np.arange(n), dead)
    source = np.zeros(n, dtype=np.int64)
    destination = np.zeros(n, dtype=np.int64)
    source[: len(dead)], destination[: len(dead)] = rng.choice(survivors, len(dead)), dead
    return source, destination, len(dead)


@pytest.mark.parametrize("epochs", [4, M + 1])
def test_any_sequence_of_touches_and_resamplings(epochs):
    """Few rows of ancestors force the store to free one; few buffers force it to grow."""
    rng = np.random.default_rng(epochs)
    columns, points, ancestors, index = store.allocate(1, M, N, store.LAZY)
    columns, ancestors = columns[:, :5].copy(), ancestors[:, :epochs].copy()
    store.clear(index, 5, store.LAZY, M)
    plain, work, known = np.zeros((M, 5, N)), np.zeros((5, N)), 0
    for _ in range(400):
        if index[0, store.SIZES, 0] < 4 and columns.shape[1] <= M:
            columns = store.grown(columns, index, 4, M)
        for j in {*rng.integers(0, min(known + 1, M), 3).tolist()}:
            known = max(known, j + 1)
            column = store.open_column(j, columns[0], points[0], ancestors[0], index[0])
            np.testing.assert_array_equal(column, plain[j])
            column[:] = plain[j] = rng.normal(size=(5, N))
        source, destination, count = resampling(rng, N)
        store.move_particles(known, columns[0], points[0], ancestors[0], index[0], source, destination, count)
        plain[:, :, destination[:count]] = plain[:, :, source[:count]]
        for j in range(known):
            read = store.read_column(j, columns[0], points[0], ancestors[0], index[0], work)
            np.testing.assert_array_equal(read, plain[j])
    assert known > 0.8 * M
    assert (index[0, store.BUFFER, :M] == store.COLLAPSED).any()
    assert len(np.unique(index[0, store.FREE, : index[0, store.SIZES, 0]])) == index[0, store.SIZES, 0]


def reachable(index, nodes, depth):
    """References to each node that can be reached from the roots, and the leaves among them, counted plainly."""
    references, leaves, waiting = {}, set(), [(n, depth) for n in index[tree_storage.ROOTS, :N]]
    while waiting:
        n, level = waiting.pop()
        if n < 0:
            continue
        references[n] = references.get(n, 0) + 1
        if level == 0:
            leaves.add(n)
        elif references[n] == 1:
            waiting += [(nodes[n, side], level - 1) for side in range(2)]
    return references, leaves


def test_a_tree_shares_counts_and_frees():
    """Any sequence of touches and resamplings: values as in plain arrays, counts as a walk finds them, no leak."""
    rng = np.random.default_rng(2)
    columns, points, nodes, index = store.allocate(1, M, N, store.TREE)
    store.clear(index, 0, store.TREE, M)
    plain, work, known = np.zeros((M, 5, N)), np.zeros((5, N)), 0
    for _ in range(300):
        columns, points, nodes = store.make_room(columns, points, nodes, index, 3, M)
        for j in {*rng.integers(0, min(known + 1, M), 3).tolist()}:
            known = max(known, j + 1)
            column = store.open_column(j, columns[0], points[0], nodes[0], index[0])
            column[:] = plain[j] = rng.normal(size=(5, N))
        store.put_away(columns[0], points[0], nodes[0], index[0])
        source, destination, count = resampling(rng, N)
        store.move_particles(known, columns[0], points[0], nodes[0], index[0], source, destination, count)
        plain[:, :, destination[:count]] = plain[:, :, source[:count]]
        for j in range(known):
            read = store.read_column(j, columns[0], points[0], nodes[0], index[0], work)
            np.testing.assert_array_equal(read, plain[j])
    references, leaves = reachable(index[0], nodes[0], 6)
    assert all(nodes[0, n, 2] == count for n, count in references.items())
    sizes = index[0, store.SIZES]
    assert len(leaves) == sizes[tree_storage.LEAVES] - sizes[tree_storage.LEAVES_FREE]
    assert (
        len(references) == sizes[tree_storage.NODES] - sizes[tree_storage.NODES_FREE] - sizes[tree_storage.LEAVES_FREE]
    )
    assert len(leaves) < known * N  # something is shared


def test_what_nobody_shares_is_written_in_place():
    columns, points, nodes, index = store.allocate(1, M, N, store.TREE)
    store.clear(index, 0, store.TREE, M)
    used = []
    for _ in range(3):
        columns, points, nodes = store.make_room(columns, points, nodes, index, 1, M)
        store.open_column(7, columns[0], points[0], nodes[0], index[0])[:] = 1.0
        store.put_away(columns[0], points[0], nodes[0], index[0])
        used.append(index[0, store.SIZES, tree_storage.NODES])
    assert used == [N * (6 + 1)] * 3


def drive(filters, landmarks, steps, seed=0):
    """The filters past a line of landmarks, ten seen after each step; yields its number."""
    for step, scan in enumerate(sweeps(landmarks, steps, seed)):
        for f in filters:
            f.predict(CONTROL, 0.1)
            f.update(scan)
        yield step


@pytest.mark.parametrize("name", ["slamto", "fastslam1", "fastslam2", "rbpf", "unscented-fastslam"])
def test_filters_are_the_same_bit_for_bit(name):
    options = {"max_landmarks": 200, "particles": 25}
    threshold = {} if name == "fastslam1" else {"resample_threshold": 0.9}
    lazy, tree, dense = filters = [
        make_estimator(name, MOTION, SENSOR, None, map_storage=kind, **threshold, **options)
        for kind in ("lazy", "tree", "dense")
    ]
    for step in drive(filters, 200, 370):
        if step % 40 == 39:
            for field in ("pose", "pose_cov", "landmark_mean", "landmark_cov", "landmark_rel", "landmark_rel_cov"):
                for other in (lazy, tree):
                    np.testing.assert_array_equal(getattr(other.belief, field), getattr(dense.belief, field))
    assert dense.belief.landmark_count[0] > 150
    assert dense.map_bytes()[0] == dense.belief.landmark_count[0] * 25 * 5 * 8
    assert lazy.map_bytes()[0] < 0.7 * dense.map_bytes()[0]
    assert tree.map_bytes()[0] < 0.7 * dense.map_bytes()[0]


def test_islands_are_the_same_bit_for_bit():
    filters = [
        make_estimator(
            "slamto", MOTION, SENSOR, None, map_storage=kind, max_landmarks=60, particles=24, islands=4,
            resample_threshold=0.9,
        )
        for kind in ("lazy", "tree", "dense")
    ]  # fmt: skip
    for _ in drive(filters, 60, 80):
        pass
    assert filters[0].counts["resampled"][0] > 50
    for field in ("pose", "pose_cov", "landmark_mean", "landmark_cov", "landmark_rel_cov"):
        for other in filters[:2]:
            np.testing.assert_array_equal(getattr(other.belief, field), getattr(filters[2].belief, field))


def test_a_tree_survives_its_state():
    """States and pickles hold the whole tree; a reset empties it."""
    first, second = (
        make_estimator("slamto", MOTION, SENSOR, None, map_storage="tree", max_landmarks=60, particles=25)
        for _ in range(2)
    )
    for _ in drive([first], 60, 40):
        pass
    second.set_state(first.get_state())
    for _ in drive([first, second], 60, 40, seed=1):
        pass
    np.testing.assert_array_equal(first.belief.landmark_mean, second.belief.landmark_mean)
    first.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0])
    assert first.map_bytes()[0] == 25 * 4  # the roots, which point nowhere
