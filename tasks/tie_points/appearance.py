"""Image retrieval: one short signature per photograph, so that finding similar photographs costs little however many there are.

A sample of the descriptors of all photographs is divided into WORDS clusters (k-means from a fixed start). The signature of a
photograph sums, for each cluster, the offsets of its own descriptors from the centre of the cluster (VLAD); every cluster is scaled
to unit length so that repeated texture does not dominate. Photographs of the same ground have signatures of nearly the same
direction. Each photograph is paired with those most similar to it: the number of pairs grows linearly with that of photographs.

Source: Jegou et al. 2010 (vectors of locally aggregated descriptors); Arandjelovic & Zisserman 2013 (normalisation).
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns
from orthomill.schemas.photo import Photos
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, Values
from orthomill.tasks.tie_points.pair_selection import Neighbourhood, candidate_pairs

WORDS = 64
SAMPLE = 400
"""descriptors of a photograph that take part in forming the clusters"""
# The clusters need not have converged: any fixed partition of the descriptor space serves, a better one only a little better.
_ROUNDS = 12
_SIMILARITY_BLOCK = 256  # rows of the similarity matrix at a time, so that memory does not grow with the square of the block


@dataclass(frozen=True)
class Signature(Columns):
    """The appearance of a photograph as a vector of unit length."""

    values: np.ndarray
    """float32 (WORDS * 128)"""


class Candidates(BaseModel):
    """Pairs (left, right) of photograph numbers worth comparing, sorted."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[tuple[int, int], ...]


def sample(photo: tuple[Features, Values]) -> Values:
    """The descriptors of the largest points of a photograph: these are the most repeatable ones."""
    largest = np.sort(np.argsort(-photo[0].size, kind="stable")[:SAMPLE])
    return Values(photo[1].rows(DESCRIPTOR)[largest].ravel())


def vocabulary(samples: tuple[Values, ...]) -> Values:
    """The centres (WORDS, 128) of the clusters as bytes."""
    points = np.concatenate([part.rows(DESCRIPTOR) for part in samples]).astype(np.float32)
    if not len(points):
        return Values(np.zeros(WORDS * DESCRIPTOR, np.uint8))
    # Evenly spaced through the photographs instead of random: a run has to be repeatable bit for bit.
    centres = points[np.linspace(0, len(points) - 1, WORDS).astype(int)]
    for _ in range(_ROUNDS):
        cluster = _nearest_centres(points, centres)
        count = np.bincount(cluster, minlength=WORDS)
        total = np.zeros((WORDS, DESCRIPTOR))
        np.add.at(total, cluster, points)
        # An empty cluster keeps its centre; rounding to integers keeps all products below exact in float32.
        centres = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], centres).round().astype(np.float32)
    return Values(centres.astype(np.uint8).ravel())


def _nearest_centres(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(N,) the nearest centre of every point; all values are integers, hence exact and the same on every machine."""
    return np.argmin((centres**2).sum(axis=1) - 2.0 * (points @ centres.T), axis=1)


def signature(photo: tuple[Features, Values], words: Values) -> Signature:
    """The signature of a photograph."""
    points, centres = photo[1].rows(DESCRIPTOR).astype(np.float32), words.rows(DESCRIPTOR).astype(np.float32)
    cluster = _nearest_centres(points, centres)
    total = np.zeros((WORDS, DESCRIPTOR))
    np.add.at(total, cluster, points - centres[cluster])
    # Signed square root and unit length per cluster: both damp "bursts" of one repeated pattern (Arandjelovic & Zisserman 2013).
    total = np.sign(total) * np.sqrt(np.abs(total))
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-9)
    return Signature((total / np.sqrt(max((np.abs(total).sum(axis=1) > 0).sum(), 1))).astype(np.float32).ravel())


def alike(photos: Photos, signatures: tuple[Signature, ...], neighbourhood: Neighbourhood) -> Candidates:
    """Pairs by appearance, for photographs without a position, added to those by position and sequence."""
    vectors = np.stack([one.values for one in signatures])
    unplaced = np.array([number for number, photo in enumerate(photos.photos) if photo.position is None], dtype=int)
    pairs = set(candidate_pairs(photos, neighbourhood))
    for start in range(0, len(unplaced), _SIMILARITY_BLOCK):
        own = unplaced[start : start + _SIMILARITY_BLOCK]
        similarity = vectors[own] @ vectors.T
        similarity[np.arange(len(own)), own] = -np.inf
        best = np.argsort(-similarity, axis=1, kind="stable")[:, : neighbourhood.nearest]
        pairs |= {(min(i, j), max(i, j)) for i, row in zip(own.tolist(), best.tolist(), strict=True) for j in row}
    return Candidates(pairs=tuple(sorted(pairs)))
