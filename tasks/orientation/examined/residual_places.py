"""The places and sizes of residuals, and the ties between photographs, as the charts of a block draw them."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from orthomill.schemas.camera import Camera
from orthomill.schemas.observations import ImageResiduals
from orthomill.tasks.orientation.examined.block_facts import Facts

PHOTOS_SHOWN, ARROWS_SHOWN, EDGES_SHOWN = 4, 150, 400
"""What remains legible in a chart of the report's size."""
BINS = 12
"""Areas along each side of a frame for mean residuals"""
STRENGTHS = (("300 tie points or more", 300, np.inf), ("100 to 299", 100, 300), ("30 to 99", 30, 100), ("fewer than 30", 1, 30))
"""Classes of connection between two photographs, by the tie points that they share"""


def _mean_residuals(own: ImageResiduals, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The middles x, y (px from the middle of the frame, y up) and mean residuals (px, as in the tables) of the areas with enough
    residuals."""
    col, row = ((v / size * BINS).astype(int).clip(0, BINS - 1) for v, size in ((own.col, camera.width), (own.row, camera.height)))
    cell = row * BINS + col
    count = np.bincount(cell, minlength=BINS * BINS)
    # The mean of one or two residuals would show their noise, not the camera.
    keep = np.flatnonzero(count >= 3)
    dx, dy = (np.bincount(cell, v, minlength=BINS * BINS)[keep] / count[keep] for v in (own.v_col, own.v_row))
    x = ((keep % BINS + 0.5) / BINS - 0.5) * camera.width
    y = (0.5 - (keep // BINS + 0.5) / BINS) * camera.height
    return x, y, dx, dy


def known_residuals(facts: Facts) -> dict[str, float]:
    """Photograph -> root mean square residual, px."""
    return {photo.photo: photo.residual_px for photo in facts.block.photos if photo.residual_px is not None}


def _shared(used: ImageResiduals, photos: int) -> np.ndarray:
    """(P, P) tie points that two photographs share."""
    seen = csr_array((np.ones(len(used), np.int32), (used.photo, used.track)), shape=(photos, int(used.track.max()) + 1))
    shared: np.ndarray = (seen @ seen.T).toarray()
    return shared


def _lines(
    pairs: list[tuple[int, int]], place: dict[int, tuple[float, float]], shared: np.ndarray, least: int, most: float
) -> tuple[float, ...]:
    """Y of the lines between photographs with `least` to below `most` common tie points. NaN interrupts a line: all classes are
    drawn over the same X."""
    nothing = (np.nan,) * 3
    ends = ((place[i][1], place[j][1], np.nan) if least <= shared[i, j] < most else nothing for i, j in pairs)
    return tuple(float(y) for end in ends for y in end)


class Arrows(NamedTuple):
    """Places x, y (px from the middle of the frame, y up) and residuals dx, dy there (px, y up)."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    dx: tuple[float, ...]
    dy: tuple[float, ...]


def residual_classes(facts: Facts) -> tuple[tuple[float, ...], dict[str, tuple[float, ...]]]:
    """Middles (px) of the classes of residuals, and how many measurements that took part are in each, along columns and rows."""
    used = facts.image.used
    # Residuals beyond four sigma0 are rejected by default, so the rest fits into these limits.
    limit = max(4.0 * facts.block.sigma0_px, 1e-6)
    edges = np.linspace(-limit, limit, 41)
    counts = {
        name: tuple(map(float, np.histogram(v[used], edges)[0]))
        for name, v in (("col", facts.image.v_col), ("row", facts.image.v_row))
    }
    return _floats(0.5 * (edges[1:] + edges[:-1])), counts


def mean_arrows(facts: Facts, name: str) -> Arrows | None:
    """Mean residual in a grid of areas over the frame of a camera: what its model leaves unexplained; None without residuals."""
    numbers = [facts.photos.names.index(photo) for photo, own in facts.block.of_photo.items() if own == name]
    own = facts.image.take(facts.image.used & np.isin(facts.image.photo, numbers))
    if not len(own):
        return None
    x, y, dx, dy = _mean_residuals(own, facts.block.cameras[name])
    return Arrows(_floats(x), _floats(y), _floats(dx), _floats(-dy))


def longest(arrows: Arrows) -> float:
    """Length of the longest residual, px; 0 without any."""
    return float(np.hypot(arrows.dx, arrows.dy).max()) if arrows.dx else 0.0


def photo_arrows(facts: Facts, name: str) -> Arrows | None:
    """The single residuals of one photograph, thinned to a legible number; None without any."""
    own = facts.image.take(facts.image.used & (facts.image.photo == facts.photos.names.index(name)))
    if not len(own):
        return None
    # Evenly through the table, which is sorted by track: a random choice would change with every report.
    own = own.take(np.unique(np.linspace(0, len(own) - 1, ARROWS_SHOWN).astype(int)))
    camera = facts.block.camera_of(name)
    x, y = own.col - (camera.width - 1) / 2, (camera.height - 1) / 2 - own.row
    return Arrows(_floats(x), _floats(y), _floats(own.v_col), _floats(-own.v_row))


class TieLines(NamedTuple):
    """Lines between the projection centres of photographs that share tie points: how many, their X, and Y by strength (m); NaN
    interrupts a line."""

    lines: int
    x: tuple[float, ...]
    y: dict[str, tuple[float, ...]]


def tie_lines(facts: Facts) -> TieLines | None:
    """The strongest ties of the block; None without tie points."""
    names = facts.photos.names
    place = {names.index(photo.photo): photo.centre[:2] for photo in facts.block.photos}
    # Surveyed points have negative numbers; they connect no photographs by matches.
    used = facts.image.take(facts.image.used & (facts.image.track >= 0))
    if not len(used):
        return None
    shared = _shared(used, len(names))
    pairs = [(i, j) for i in place for j in place if i < j and shared[i, j] > 0]
    pairs = sorted(pairs, key=lambda pair: -shared[pair])[:EDGES_SHOWN]
    series = {label: _lines(pairs, place, shared, least, most) for label, least, most in STRENGTHS}
    x = tuple(float(x) for i, j in pairs for x in (place[i][0], place[j][0], np.nan))
    return TieLines(len(pairs), x, {label: values for label, values in series.items() if np.isfinite(values).any()})


def _floats(values: np.ndarray) -> tuple[float, ...]:
    return tuple(map(float, values))
