"""Noise without state: every number is a hash of what it belongs to (seed, photo, row, column, or a place on the ground).

A value therefore depends neither on the tile that computes it nor on the order of the work. The mixing is that of SplitMix64
(Steele, Lea and Flood 2014); value noise interpolates hashed lattice values with a smooth step.

numba turns a uint64 together with an int64 into a float64: every constant and shift below is therefore a uint64.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

# SplitMix64: the increment is 2^64 over the golden ratio, the two multipliers mix high bits into low ones (Stafford's variant 13).
_INCREMENT = np.uint64(0x9E3779B97F4A7C15)
_MULTIPLIER_1 = np.uint64(0xBF58476D1CE4E5B9)
_MULTIPLIER_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_1, _SHIFT_2, _SHIFT_3 = np.uint64(30), np.uint64(27), np.uint64(31)
# 53 of the 64 bits: as many as the mantissa of a float64 holds, so that all values in [0, 1) are equally likely.
_TO_MANTISSA, _MANTISSA = np.uint64(11), 9007199254740992.0
_BITS_16, _BITS_32, _BITS_48 = np.uint64(16), np.uint64(32), np.uint64(48)
_LOW_16 = np.uint64(0xFFFF)
# Four uniform numbers 0 to 65535 have the mean 131070 together and the variance 4 * 65536^2 / 12.
_NORMAL_MEAN, _NORMAL_SCALE = 131070.0, np.sqrt(3.0) / 65536.0


@njit(inline="always")
def mixed(value):
    """A uint64 scrambled to a uint64: one step of SplitMix64."""
    value = value + _INCREMENT
    value = (value ^ (value >> _SHIFT_1)) * _MULTIPLIER_1
    value = (value ^ (value >> _SHIFT_2)) * _MULTIPLIER_2
    return value ^ (value >> _SHIFT_3)


@njit(inline="always")
def hash_of(seed, first, second):
    """uint64 hash of a seed and two integers, negative ones included."""
    inner = mixed(np.uint64(seed) * _MULTIPLIER_1 + np.uint64(np.int64(first)))
    # Mixed once more with the second number: a sum of the two would repeat along diagonals.
    return mixed(inner + np.uint64(np.int64(second)) * _INCREMENT)


@njit(inline="always")
def uniform_of(seed, first, second):
    """A number in [0, 1) that belongs to a seed and two integers."""
    return float(hash_of(seed, first, second) >> _TO_MANTISSA) * (1.0 / _MANTISSA)


@njit(inline="always")
def normal_of(seed, first, second):
    """A number of mean 0 and standard deviation 1 that belongs to a seed and two integers: the sum of four uniform ones.

    Nearly normal (kurtosis 2.7), and never beyond 3.5.
    """
    # One hash gives all four uniform numbers; Box-Muller would cost a logarithm and a cosine for every pixel and band.
    bits = hash_of(seed, first, second)
    total = (
        float(bits & _LOW_16) + float((bits >> _BITS_16) & _LOW_16) + float((bits >> _BITS_32) & _LOW_16) + float(bits >> _BITS_48)
    )
    return (total - _NORMAL_MEAN) * _NORMAL_SCALE


@njit(inline="always")
def value_noise(seed, x, y):
    """Smooth noise in [-1, 1] over the plane, with lattice points at integers."""
    column, row = np.floor(x), np.floor(y)
    along, down = x - column, y - row
    # The smooth step has no slope at either end: without it the lattice shows as creases.
    along = along * along * (3.0 - 2.0 * along)
    down = down * down * (3.0 - 2.0 * down)
    i, j = np.int64(column), np.int64(row)
    top = uniform_of(seed, i, j) * (1.0 - along) + uniform_of(seed, i + 1, j) * along
    bottom = uniform_of(seed, i, j + 1) * (1.0 - along) + uniform_of(seed, i + 1, j + 1) * along
    return 2.0 * (top * (1.0 - down) + bottom * down) - 1.0
