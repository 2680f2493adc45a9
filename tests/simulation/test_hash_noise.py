"""Hashed noise against SplitMix64 in plain integers, its distribution, and its independence."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from orthomill.tasks.simulation.scene.hash_noise import hash_of, mixed, normal_of, uniform_of, value_noise

_MASK = 2**64 - 1
_GOLDEN, _MIX_1, _MIX_2 = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


def split_mix(value: int) -> int:
    """SplitMix64 (Steele, Lea and Flood 2014) in integers of any length."""
    value = (value + _GOLDEN) & _MASK
    value = ((value ^ (value >> 30)) * _MIX_1) & _MASK
    value = ((value ^ (value >> 27)) * _MIX_2) & _MASK
    return value ^ (value >> 31)


def plain_hash(seed: int, first: int, second: int) -> int:
    inner = split_mix((seed * _MIX_1 + first) & _MASK)
    return split_mix((inner + second * _GOLDEN) & _MASK)


@njit
def _grid(seed, rows, cols):
    out = np.empty((rows, cols), np.uint64)
    for row in range(rows):
        for col in range(cols):
            out[row, col] = hash_of(seed, row, col)
    return out


@njit
def _draws(seed, rows, cols):
    uniform, normal = np.empty((rows, cols)), np.empty((rows, cols))
    for row in range(rows):
        for col in range(cols):
            uniform[row, col], normal[row, col] = uniform_of(seed, row, col), normal_of(seed, row, col)
    return uniform, normal


@njit
def _noise(seed, x, y):
    out = np.empty(x.size)
    for k in range(x.size):
        out[k] = value_noise(seed, x[k], y[k])
    return out


@pytest.fixture(scope="module")
def draws():
    return _draws(11, 300, 400)


def test_the_published_sequence_of_splitmix64():
    """The first numbers of the generator with state 0, as its authors' code prints them."""
    state, found = 0, []
    for _ in range(3):
        found.append(int(mixed(np.uint64(state))))
        state = (state + _GOLDEN) & _MASK
    assert found == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]


def test_compiled_hashes_are_those_of_plain_integers():
    found = _grid(2009, 20, 30)
    assert all(int(found[row, col]) == plain_hash(2009, row, col) for row in range(20) for col in range(30))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), first=st.integers(-(2**40), 2**40), second=st.integers(-(2**40), 2**40))
def test_negative_numbers_have_hashes_of_their_own(seed, first, second):
    assert int(hash_of(seed, first, second)) == plain_hash(seed, first, second)


def test_uniform_numbers_fill_the_unit_interval_evenly(draws):
    uniform, _ = draws
    assert uniform.min() >= 0.0 and uniform.max() < 1.0
    counts = np.histogram(uniform, 20, (0, 1))[0]
    assert np.abs(counts - uniform.size / 20).max() < 5 * np.sqrt(uniform.size / 20)


def test_normal_numbers_have_their_moments(draws):
    _, normal = draws
    assert normal.mean() == pytest.approx(0.0, abs=0.01) and normal.std() == pytest.approx(1.0, abs=0.01)
    assert (normal**4).mean() == pytest.approx(2.7, abs=0.05), "four uniform numbers: 3 - 6 / 5 / 4"
    assert np.abs(normal).max() <= np.sqrt(12.0) + 1e-9


@pytest.mark.parametrize("lag", [(0, 1), (1, 0), (1, 1), (1, -1)])
def test_neighbours_are_not_correlated(draws, lag):
    _, normal = draws
    moved = np.roll(normal, lag, axis=(0, 1))
    assert abs(np.corrcoef(normal.ravel(), moved.ravel())[0, 1]) < 0.015


def test_other_seeds_give_other_numbers(draws):
    other = _draws(12, 300, 400)[1]
    assert abs(np.corrcoef(draws[1].ravel(), other.ravel())[0, 1]) < 0.015


def test_value_noise_meets_its_lattice_and_is_smooth():
    k = np.arange(-20.0, 20.0)
    at = _noise(5, k, 2 * k)
    assert np.allclose(at, [2 * uniform_of(5, int(i), int(2 * i)) - 1 for i in k])
    x = np.linspace(-3, 3, 6001)
    line = _noise(5, x, np.full(x.size, 0.37))
    assert np.abs(line).max() <= 1.0 and np.abs(np.diff(line)).max() < 4.0 * 1e-3
    lattice = np.abs(x - np.rint(x)) < 2e-3
    assert np.abs(np.gradient(line, x))[lattice].max() < 0.05, "no slope at the lattice points"
