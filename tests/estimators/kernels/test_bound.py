"""A bound kernel does what the kernel does, to the arrays it was bound to, also after copies."""

import copy
import pickle

import numpy as np
import pytest

from estimators.kernels.bound import LATER, bind, chain
from estimators.kernels.jit import jit
from estimators.models import MODEL, MotionModel, SensorModel, pack_models


@jit
def mix(out, model, table, flags, whole, factor, yes, lanes):
    """Every kind of argument, each of which counts."""
    for i in range(lanes.size):
        lane = lanes[i]
        out[lane] += factor * table[lane, 1, 2] + whole * model[lane].bearing_std + (0.5 if yes else 0.25)
        if flags[lane]:
            out[lane] += table.shape[0] + 10 * table.shape[1] + 100 * table.shape[2]
    return out[0] > 0.0


@pytest.fixture
def arguments():
    models = np.empty(2, dtype=MODEL)
    models[:] = pack_models(MotionModel(), SensorModel(), None)
    return np.zeros(2), models, np.arange(24.0).reshape(2, 3, 4), np.array([True, False]), 3, 0.1, True


def test_equals_the_plain_call(arguments):
    out, *rest = arguments
    plain, lanes = np.zeros(2), np.arange(2)
    bound = bind(mix, out, *rest, LATER)
    for _ in range(3):
        assert bound(lanes) == mix(plain, *rest, lanes)
    np.testing.assert_array_equal(out, plain)
    assert out[0] > 300.0


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda held: pickle.loads(pickle.dumps(held))])
def test_a_copy_is_bound_to_the_copied_arrays(arguments, duplicate):
    out, *rest = arguments
    held = {"out": out, "call": bind(mix, out, *rest, LATER)}
    other = duplicate(held)
    other["call"](np.arange(2))
    assert out[0] == 0.0
    assert other["out"][0] != 0.0


def test_refuses_an_array_with_gaps(arguments):
    out, models, table, *rest = arguments
    with pytest.raises(ValueError, match="contiguous"):
        bind(mix, out, models, table[:, :, ::2], *rest, LATER)


def test_the_name_tells_kernels_apart(arguments):
    out, *rest = arguments
    assert "mix" in bind(mix, out, *rest, LATER).func.__name__
    assert "double" in bind(double, out).func.__name__


@jit
def count_up(out, limit, lanes):
    """Adds one to each lane; False once the first has reached the limit."""
    for i in range(lanes.size):
        out[lanes[i]] += 1.0
    return out[0] < limit


@jit
def double(out):
    """A kernel without later arguments that returns nothing."""
    for i in range(out.size):
        out[i] *= 2.0


class TestChain:
    def test_runs_every_kernel_in_turn(self):
        out, lanes = np.zeros(3), np.array([0, 2])
        both = chain(bind(count_up, out, 10.0, LATER), bind(double, out), bind(count_up, out, 10.0, LATER))
        assert both(lanes) is True
        np.testing.assert_array_equal(out, [3.0, 0.0, 3.0])

    def test_stops_at_the_kernel_that_says_no(self):
        out = np.zeros(2)
        assert chain(bind(count_up, out, 1.0, LATER), bind(double, out))(np.arange(2)) is False
        np.testing.assert_array_equal(out, [1.0, 1.0])

    def test_chains_of_chains_and_their_copies(self):
        out = np.zeros(2)
        inner = chain(bind(count_up, out, 10.0, LATER), bind(double, out))
        held = {"out": out, "call": chain(inner, inner)}
        other = pickle.loads(pickle.dumps(held))
        assert other["call"](np.arange(2)) is True
        np.testing.assert_array_equal(other["out"], [6.0, 6.0])
        np.testing.assert_array_equal(out, [0.0, 0.0])


def test_apart_has_scratch_of_its_own_and_shares_the_rest(arguments):
    out, models, table, *rest = arguments
    bound = bind(mix, out, models, table, *rest, LATER)
    other = bound.apart((table,))
    table[:] = 0.0
    own = np.zeros(2)
    mix(own, models, np.arange(24.0).reshape(2, 3, 4), *rest, np.arange(2))
    other(np.arange(2))
    np.testing.assert_array_equal(out, own)
    assert other.func is bound.func
