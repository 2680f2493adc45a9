"""Samples of ground that several photographs share: what the balance of a block is found from."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.job import Columns

_SATURATED = 0.012  # share of the range, three grey levels of 8 bits, next to black and white


@dataclass(frozen=True)
class Samples(Columns):
    """One row per photo that sees a sample of the ground; rows of a point follow each other."""

    point: np.ndarray
    """int64: number of the sample on the ground"""
    photo: np.ndarray
    """int32: number of the photo in the block"""
    r2: np.ndarray
    """float32: squared distance from the photo's middle, half diagonals"""
    first: np.ndarray
    second: np.ndarray
    third: np.ndarray
    """float32 grey values; equal for a grey photo"""

    @property
    def grey(self) -> np.ndarray:
        """(N, 3)"""
        return np.column_stack([self.first, self.second, self.third]).astype(np.float64)


def sample_rows(number: np.ndarray, photo: int, colour: np.ndarray, weight: np.ndarray, r2: np.ndarray) -> tuple[np.ndarray, ...]:
    """Columns of samples in one photograph, of the places (...) where its colour (..., bands) is worth something: `number` (...) of
    the places, `photo` in the block."""
    known = weight > 0
    grey = np.broadcast_to(colour[known], (int(known.sum()), 3))
    return number[known], np.full(len(grey), photo), r2[known], *grey.T


def seen_twice(rows: list[tuple[np.ndarray, ...]]) -> Samples:
    """The samples of points that two photos or more see, sorted by point, then photo. rows: columns of one photo each."""
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)] if rows else [np.zeros(0)] * 6
    point, photo = columns[0].astype(np.int64), columns[1].astype(np.int32)
    r2, first, second, third = (column.astype(np.float32) for column in columns[2:])
    samples = Samples(point, photo, r2, first, second, third)
    if not len(samples):
        return samples
    _, group, counts = np.unique(point, return_inverse=True, return_counts=True)
    order = np.lexsort((photo, point))
    return samples.take(order[counts[group][order] >= 2])


def grouped(point: np.ndarray) -> tuple[np.ndarray, int]:
    """Points (N,) renumbered from 0 without gaps, and their number."""
    numbers, group = np.unique(point, return_inverse=True)
    return group, len(numbers)


def usable_samples(samples: Samples, black: float, white: float) -> Samples:
    """Samples that are not saturated, at points that two photos or more still see."""
    grey = samples.grey
    # A clipped grey value is no linear function of the ground's brightness.
    edge = _SATURATED * (white - black)
    samples = samples.take(np.all((grey > black + edge) & (grey < white - edge), axis=1))
    if not len(samples):
        return samples
    group, count = grouped(samples.point)
    return samples.take(np.bincount(group, minlength=count)[group] >= 2)


def pair_differences(point: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """Absolute differences (M,) of each row's grey values (N, bands), mean over bands, from the row before it at the same point."""
    order = np.argsort(point, kind="stable")
    same = point[order][1:] == point[order][:-1]
    return np.abs(np.diff(grey[order], axis=0)).mean(axis=1)[same]
