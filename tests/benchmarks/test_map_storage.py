"""Time and memory of the particles' maps against the number of landmarks, by storage.

`pytest -m benchmark -s tests/benchmarks/test_map_storage.py` prints the table. Times depend on the machine: only ratios
are asserted.
"""

import pytest

from slam_gym.benchmark.maps import map_rows

pytestmark = pytest.mark.benchmark


SIZES = {"lazy": (100, 800, 6400), "tree": (100, 800, 6400), "dense": (100, 800)}


@pytest.fixture(scope="module")
def table():
    rows = map_rows([(kind, n) for kind, all_n in SIZES.items() for n in all_n])
    for row in rows:
        print(
            f"\n{row['storage']:5} {row['landmarks']:5} landmarks {row['microseconds']:7.1f} us, "
            f"of it resampling {100.0 * row['resampling']:3.0f} %; {row['used']:6.2f} MB in use, "
            f"{row['megabytes']:6.2f} MB set aside",
            end="",
        )
    return {(row["storage"], row["landmarks"]): row for row in rows}


def test_lazy_columns_do_not_notice_the_size_of_the_map(table):
    assert (
        table["lazy", 6400]["microseconds"] < 1.4 * table["lazy", 100]["microseconds"]
    )  # 64 times the landmarks; the caches notice
    assert table["lazy", 6400]["microseconds"] < 0.1 * table["dense", 800]["microseconds"]
    assert table["lazy", 6400]["megabytes"] < 3.0


def test_resampling_is_a_small_share_of_a_step_with_lazy_columns(table):
    """About a quarter, a little more where wide vectors shorten the rest of the step."""
    assert all(table["lazy", n]["resampling"] < 0.3 for n in (100, 800, 6400))


def test_the_tree_saves_memory_and_pays_with_time_that_grows_as_the_logarithm(table):
    assert table["tree", 6400]["used"] < 1.0
    assert table["tree", 800]["used"] < 0.05 * table["dense", 800]["used"]
    assert table["tree", 6400]["microseconds"] < 3.0 * table["tree", 100]["microseconds"]
