"""How strongly the tie points connect the photographs: how many, where in the frame, and with which others."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orthomill.schemas.observations import TiePoints
from orthomill.schemas.photo import Photos
from orthomill.tasks.imagery.photograph_rows import rows_of_photos

FRAME_CELLS = 8
# Von Gruber's nine areas along 3 x 3: a relative orientation needs points in six of them at least.
_GRUBER = 3
# Tie points below which a photograph or a pair is poorly connected: five parameters of a relative orientation leave a redundancy
# of 25, enough to find the gross errors that automatic matching contains.
WEAK = 30


@dataclass(frozen=True)
class Strength:
    """Connections of each photograph (arrays by photograph number) and of the block."""

    observations: np.ndarray
    partners: np.ndarray
    """photographs that share `WEAK` tie points or more"""
    coverage: np.ndarray
    """share of the frame's cells that hold a tie point"""
    block: np.ndarray
    """number of the connected part of the block; -1 for photographs without tie points"""
    rays: np.ndarray
    """photographs per tie point (by tie point)"""
    evenness: np.ndarray
    """distribution index: 1 when the nine von Gruber areas of the frame hold equally many tie points, 0 when one holds all"""

    @property
    def fewest(self) -> int:
        """Tie points of the photograph with the fewest."""
        return int(self.observations.min())

    @property
    def median_evenness(self) -> float:
        """Distribution index, median of the photographs."""
        return float(np.median(self.evenness))

    @property
    def parts(self) -> list[list[int]]:
        """Numbers of the photographs of each part of the block, in the order of the parts."""
        return [np.flatnonzero(self.block == part).tolist() for part in np.unique(self.block) if part >= 0]

    @property
    def points_by_rays(self) -> list[int]:
        """Tie points that two photographs show, three, and so on."""
        return np.bincount(self.rays)[2:].tolist()


def measure(points: TiePoints, photos: Photos) -> Strength:
    """How strongly each photograph is connected with the others."""
    count = len(photos.photos)
    shared = shared_points(points, count)
    observations = np.bincount(points.photo, minlength=count)
    # Parts are separated more leniently than partners are counted: a warning about a divided block should be beyond doubt.
    _, block = connected_components(coo_array(shared >= WEAK // 2), directed=False)
    frame = np.array([(photo.width, photo.height) for photo in photos.photos])
    cell = np.clip(np.column_stack([points.col, points.row]) / frame[points.photo] * FRAME_CELLS, 0, FRAME_CELLS - 1).astype(int)
    rows = rows_of_photos(points.photo, count)
    filled = np.unique(np.column_stack([points.photo, cell]), axis=0)[:, 0]
    return Strength(
        observations=observations,
        partners=(shared >= WEAK).sum(axis=1),
        coverage=np.bincount(filled, minlength=count) / FRAME_CELLS**2,
        block=np.where(observations > 0, block, -1),
        rays=np.bincount(points.track),
        evenness=np.array([distribution_index(points.take(own), size) for own, size in zip(rows, frame, strict=True)]),
    )


def distribution_index(own: TiePoints, size: np.ndarray) -> float:
    """How evenly the points of one photograph of `size` (width, height) fill its von Gruber areas: the entropy of their shares in
    units of that of equal shares, 0 to 1."""
    if not len(own):
        return 0.0
    area = np.clip(np.column_stack([own.col, own.row]) / size * _GRUBER, 0, _GRUBER - 1).astype(int)
    count = np.bincount(area[:, 1] * _GRUBER + area[:, 0], minlength=_GRUBER**2)
    share = count[count > 0] / len(own)
    return float(-(share * np.log(share)).sum() / np.log(_GRUBER**2)) + 0.0  # turns -0.0, all points in one area, into 0.0


def shared_points(points: TiePoints, photos: int) -> np.ndarray:
    """(photos, photos) int: tie points that two photographs share; the diagonal is zero."""
    shows = coo_array(
        (np.ones(len(points), dtype=np.int64), (points.photo, points.track)), shape=(photos, points.track.max(initial=0) + 1)
    )
    shared = (shows.tocsr() @ shows.tocsr().T).toarray()
    np.fill_diagonal(shared, 0)
    return shared
