"""Time and memory of the particles' maps against the number of landmarks, by storage.

`pytest -m benchmark -s tests/benchmarks/test_map_storage.py` prints the table. Times depend on the machine: only ratios
are asserted.
"""

import pytest

from slam_gym.benchmark.maps import map_row

pytestmark = pytest.mark.benchmark


def _cost(kind, landmarks):
    row = map_row(kind, landmarks)
    return row["microseconds"], row["used"], row["megabytes"], row["resampling"]


@pytest.fixture(scope="module")
def table():
    sizes = {"lazy": (100, 800, 6400), "tree": (100, 800, 6400), "dense": (100, 800)}
    found = {(kind, n): _cost(kind, n) for kind, all_n in sizes.items() for n in all_n}
    for (kind, n), (microseconds, used, aside, share) in found.items():
        print(
            f"\n{kind:5} {n:5} landmarks {microseconds:7.1f} us, of it resampling {100.0 * share:3.0f} %; "
            f"{used:6.2f} MB in use, {aside:6.2f} MB set aside",
            end="",
        )
    return found


def test_lazy_columns_do_not_notice_the_size_of_the_map(table):
    assert table["lazy", 6400][0] < 1.4 * table["lazy", 100][0]  # 64 times the landmarks; the caches notice
    assert table["lazy", 6400][0] < 0.1 * table["dense", 800][0]
    assert table["lazy", 6400][2] < 3.0


def test_resampling_is_a_quarter_of_a_step_with_lazy_columns(table):
    assert all(table["lazy", n][3] < 0.25 for n in (100, 800, 6400))


def test_the_tree_saves_memory_and_pays_with_time_that_grows_as_the_logarithm(table):
    assert table["tree", 6400][1] < 1.0
    assert table["tree", 800][1] < 0.05 * table["dense", 800][1]
    assert table["tree", 6400][0] < 3.0 * table["tree", 100][0]
