"""Which photographs look alike: one short signature per photograph, so that the search costs little however many there are.

A sample of the descriptors of all photographs is sorted into WORDS heaps (k-means from a fixed start). The signature of a
photograph says, for each heap, how its own descriptors lie about the middle of the heap (VLAD), every heap brought to the same
length so that repeated texture does not drown the rest. Photographs of the same ground have signatures in nearly the same
direction. Each photograph is paired with those most like it: the number of pairs grows with the number of photographs.

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
"""descriptors of a photograph that take part in forming the heaps"""
_ROUNDS = 12
_LIKENESS_BLOCK = 256


@dataclass(frozen=True)
class Signature(Columns):
    """What a photograph looks like, of unit length."""

    values: np.ndarray
    """float32 (WORDS * 128)"""


class Candidates(BaseModel):
    """Pairs (left, right) of photograph numbers worth comparing, sorted."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[tuple[int, int], ...]


def sample(photo: tuple[Features, Values]) -> Values:
    """The descriptors of the largest points of a photograph: they are found again most surely."""
    largest = np.sort(np.argsort(-photo[0].size, kind="stable")[:SAMPLE])
    return Values(photo[1].rows(DESCRIPTOR)[largest].ravel())


def vocabulary(samples: tuple[Values, ...]) -> Values:
    """The middles (WORDS, 128) of the heaps as bytes."""
    points = np.concatenate([part.rows(DESCRIPTOR) for part in samples]).astype(np.float32)
    if not len(points):
        return Values(np.zeros(WORDS * DESCRIPTOR, np.uint8))
    middles = points[np.linspace(0, len(points) - 1, WORDS).astype(int)]
    for _ in range(_ROUNDS):
        heap = _heaps(points, middles)
        count = np.bincount(heap, minlength=WORDS)
        total = np.zeros((WORDS, DESCRIPTOR))
        np.add.at(total, heap, points)
        middles = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], middles).round().astype(np.float32)
    return Values(middles.astype(np.uint8).ravel())


def _heaps(points: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """(N,) the nearest middle of every point; whole numbers, so that the same on every machine."""
    return np.argmin((middles**2).sum(axis=1) - 2.0 * (points @ middles.T), axis=1)


def signature(photo: tuple[Features, Values], words: Values) -> Signature:
    """The signature of a photograph."""
    points, middles = photo[1].rows(DESCRIPTOR).astype(np.float32), words.rows(DESCRIPTOR).astype(np.float32)
    heap = _heaps(points, middles)
    total = np.zeros((WORDS, DESCRIPTOR))
    np.add.at(total, heap, points - middles[heap])
    total = np.sign(total) * np.sqrt(np.abs(total))
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-9)
    return Signature((total / np.sqrt(max((np.abs(total).sum(axis=1) > 0).sum(), 1))).astype(np.float32).ravel())


def alike(photos: Photos, signatures: tuple[Signature, ...], neighbourhood: Neighbourhood) -> Candidates:
    """Pairs by appearance, for photographs without a position, added to those by position and sequence."""
    vectors = np.stack([one.values for one in signatures])
    unplaced = np.array([number for number, photo in enumerate(photos.photos) if photo.position is None], dtype=int)
    pairs = set(candidate_pairs(photos, neighbourhood))
    for start in range(0, len(unplaced), _LIKENESS_BLOCK):
        own = unplaced[start : start + _LIKENESS_BLOCK]
        likeness = vectors[own] @ vectors.T
        likeness[np.arange(len(own)), own] = -np.inf
        best = np.argsort(-likeness, axis=1, kind="stable")[:, : neighbourhood.nearest]
        pairs |= {(min(i, j), max(i, j)) for i, row in zip(own.tolist(), best.tolist(), strict=True) for j in row}
    return Candidates(pairs=tuple(sorted(pairs)))
