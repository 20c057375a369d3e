"""Philox against the published vectors, and the draws made of it."""

import numpy as np
import pytest
from scipy import stats

from estimators.kernels.jit import jit
from estimators.kernels.random import lane_key, normal4, philox, uniform4

# Random123, kat_vectors, philox4x32 with 10 rounds: counter, key, answer.
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@jit
def fill(key, uniforms, normals):
    for i in range(len(uniforms)):
        uniforms[i] = uniform4(key, 3, i, 1, 7)
        normals[i] = normal4(key, 3, i, 2, 7)


@pytest.fixture(scope="module")
def draws():
    uniforms, normals = np.empty((50_000, 4)), np.empty((50_000, 4))
    fill(lane_key(11), uniforms, normals)
    return uniforms, normals


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_philox_gives_the_published_words(counter, key, answer):
    assert tuple(int(word) for word in philox(np.uint64(key[0] | key[1] << 32), *counter)) == answer


def test_uniforms_are_uniform_and_open(draws):
    uniforms, _ = draws
    assert uniforms.min() > 0.0
    assert uniforms.max() < 1.0
    for column in uniforms.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3


def test_normals_are_normal_and_independent(draws):
    _, normals = draws
    for column in normals.T:
        assert stats.kstest(column, "norm").pvalue > 1e-3
    correlation = np.corrcoef(np.column_stack([normals[:-1], normals[1:], normals[1:] ** 2]).T)
    # A normal and its own square are the noisiest pair: deviation sqrt(5/n).
    assert np.abs(correlation - np.eye(12)).max() < 4.0 * np.sqrt(5.0 / len(normals))


def test_a_draw_depends_on_every_part_of_its_name():
    names = {philox(np.uint64(5), *np.eye(4, dtype=np.uint64)[i] * np.uint64(9)) for i in range(4)}
    names |= {
        philox(np.uint64(5), 0, 0, 0, 0),
        philox(np.uint64(6), 0, 0, 0, 0),
        philox(np.uint64(5 << 32), 0, 0, 0, 0),
    }
    assert len(names) == 7


def test_lane_keys_do_not_collide():
    assert len({int(lane_key(seed, purpose)) for seed in range(500) for purpose in range(4)}) == 2000
    assert lane_key(3) == lane_key(3, 0)
