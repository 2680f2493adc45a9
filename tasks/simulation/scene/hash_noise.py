"""Noise without state: every number is a hash of what it belongs to (seed, photo, row, column, or a place on the ground).

A value therefore depends neither on the tile that computes it nor on the order of the work. The mixing is that of SplitMix64
(Steele, Lea and Flood 2014); value noise interpolates hashed lattice values with a smooth step.
"""

import numpy as np
from numba import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_S16, _S32, _S48, _S11 = np.uint64(16), np.uint64(32), np.uint64(48), np.uint64(11)
_LOW16 = np.uint64(0xFFFF)
_NORMAL_SCALE = np.sqrt(3.0) / 65536.0


@njit(cache=True, inline="always")
def mixed(value):
    """A uint64 scrambled to a uint64."""
    value = value + _GOLDEN
    value = (value ^ (value >> _S30)) * _MIX1
    value = (value ^ (value >> _S27)) * _MIX2
    return value ^ (value >> _S31)


@njit(cache=True, inline="always")
def hash_of(seed, a, b):
    """uint64 hash of three integers."""
    return mixed(mixed(np.uint64(seed) * _MIX1 + np.uint64(np.int64(a))) + np.uint64(np.int64(b)) * _GOLDEN)


@njit(cache=True, inline="always")
def uniform_of(seed, a, b):
    """A number in [0, 1) that belongs to three integers."""
    return float(hash_of(seed, a, b) >> _S11) * (1.0 / 9007199254740992.0)


@njit(cache=True, inline="always")
def normal_of(seed, a, b):
    """A number of mean 0 and standard deviation 1 that belongs to three integers: the sum of four uniform ones.

    Nearly normal (kurtosis 2.7), and never beyond 3.5.
    """
    bits = hash_of(seed, a, b)
    total = float(bits & _LOW16) + float((bits >> _S16) & _LOW16) + float((bits >> _S32) & _LOW16) + float(bits >> _S48)
    return (total - 131070.0) * _NORMAL_SCALE


@njit(cache=True, inline="always")
def value_noise(seed, x, y):
    """Smooth noise in [-1, 1] over the plane, with lattice points at whole numbers."""
    column, row = np.floor(x), np.floor(y)
    fx, fy = x - column, y - row
    fx = fx * fx * (3.0 - 2.0 * fx)
    fy = fy * fy * (3.0 - 2.0 * fy)
    i, j = np.int64(column), np.int64(row)
    top = uniform_of(seed, i, j) * (1.0 - fx) + uniform_of(seed, i + 1, j) * fx
    bottom = uniform_of(seed, i, j + 1) * (1.0 - fx) + uniform_of(seed, i + 1, j + 1) * fx
    return 2.0 * (top * (1.0 - fy) + bottom * fy) - 1.0
