"""A photograph joins a block by its orientation relative to one that is placed, where it sees too few known points for a resection.

At a weak link (the end of a strip, one photograph lost) two photographs may share fifty matches and the block beyond them five
points. The pair determines all but the length of its base, and a single known point determines that; further ones check it.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from orthomill.schemas.orientation import RelativeOrientation
from orthomill.tasks.geometry.rotation import rotation_matrix

LEAST_AGREEING = 3
"""Known points that agree on the length of the base, one of which determines it: two others do not by chance."""
TRIED = 60
"""Lengths of the base that are tried of a pair, at most: a photograph that sees a thousand known points would try a thousand, each
on all of its points, for every pair."""


class Ahead(NamedTuple):
    """A photograph as a pair puts it: its `rotation` (3, 3), and its centre somewhere along `direction` (3,) from `origin` (3,)."""

    rotation: np.ndarray
    origin: np.ndarray
    direction: np.ndarray


def by_pairs(
    name: str, placed: dict[str, tuple[np.ndarray, np.ndarray]], relative: tuple[RelativeOrientation, ...]
) -> Iterator[Ahead]:
    """Where the oriented pairs of a photograph put it, those with most matches first; `placed`: rotations (3, 3) and centres (3,)
    of the photographs of the block."""
    own = [pair for pair in relative if pair.oriented and name in (pair.left, pair.right)]
    for pair in sorted(own, key=lambda pair: -pair.kept):
        other = pair.right if pair.left == name else pair.left
        if other in placed:
            yield _ahead(pair, *placed[other], from_left=pair.right == name)


def _ahead(pair: RelativeOrientation, rotation: np.ndarray, centre: np.ndarray, from_left: bool) -> Ahead:
    turn, base = rotation_matrix(*np.radians(pair.omega_phi_kappa)), np.array(pair.base)
    if from_left:
        return Ahead(turn @ rotation, centre, rotation.T @ base)
    left = turn.T @ rotation
    return Ahead(left, centre, -left.T @ base)


def base_lengths(ahead: Ahead, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(k,) lengths of the base at which rays with `directions` (n, 3) come nearest to their points (n, 3), without those that no
    length changes, and those against the direction of the base."""
    needed, given = np.cross(directions, points - ahead.origin), np.cross(directions, ahead.direction)
    below = (given**2).sum(axis=1)
    length = (needed * given).sum(axis=1) / np.maximum(below, 1e-12)
    return np.asarray(length[(below > 1e-6) & (length > 0)])


def spread_lengths(lengths: np.ndarray) -> np.ndarray:
    """At most `TRIED` of some lengths (k,), evenly spread over their order: half of the rays have to agree on a length, so half of
    these stand for it, and trying all would cost the square of the rays."""
    if len(lengths) <= TRIED:
        return lengths
    return np.asarray(np.sort(lengths)[np.linspace(0, len(lengths) - 1, TRIED).round().astype(int)])
