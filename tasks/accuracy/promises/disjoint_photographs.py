"""Tie points that photographs without a common one determine: two strips beside each other, one photograph against all others.

Strategy. A point that two strips show twice each is intersected by each strip alone: their difference is promised by the
covariances of the orientations of all four photographs and the noise of their rays. A photograph is left out by intersecting its
points from all others: where its own ray goes past them, and by how much that was to be expected, takes no ray of its own. The
orientations are those of the whole block, of which one point decides little. Some hundred points, spread evenly over all, are
enough, and points with the same photographs count as one observation, for their orientations err once.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np

from orthomill.schemas.accuracy.promised_errors import PhotographDifferences
from orthomill.schemas.observations import GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.accuracy.adjustment.joint_covariance import StoredCovariance, WeighedRays, by_point
from orthomill.tasks.geometry.view import View, block_view

MOST = 150
"""points of either kind"""
_ALONG = np.cos(np.radians(30.0))
"""cosine of the angle up to which two moves from photograph to photograph have one direction"""
_FEWEST = 2
"""rays of either side"""
_TRIES = 8 * MOST
"""points that are looked at: those between photographs whose covariance is not stored tell nothing"""
STRIPS, LEFT_OUT = 0, 1


@dataclass(frozen=True, eq=False)
class _Point:
    """A tie point (3,) m, and where its photographs measured it (2,), px."""

    place: np.ndarray
    pixels: dict[str, np.ndarray]


def photograph_differences(block: Block, rays: ImageResiduals, points: GroundPoints, photos: Photos) -> PhotographDifferences:
    """Differences between strips (m) and of photographs that are left out (px), with their promised standard errors."""
    # A block of another program may promise nothing.
    views = {name: block_view(block, name) for name in block.names if block.of(name).covariance is not None}
    strip_of, covariance = strips_of(block, photos), StoredCovariance(block, block.sigma0_px)
    found: list[tuple[int, int, float, float]] = []
    groups: dict[tuple[str, ...], int] = {}
    for kind, chosen in ((STRIPS, _between_strips), (LEFT_OUT, _left_out)):
        done = 0
        tried = islice(_spread(rays, points, [photo.name for photo in photos.photos], set(views)), _TRIES)
        for point in tried:
            if done >= MOST:
                break
            for key, difference, weighed in chosen(point, strip_of, covariance, views):
                spread = covariance.of_points(weighed, weighed)
                if spread is None:
                    continue
                group = groups.setdefault((str(kind), *key), len(groups))
                sigma = np.sqrt(np.maximum(np.diag(spread), 0.0))
                found += [(kind, group, float(d), float(s)) for d, s in zip(difference, sigma, strict=True)]
                done += 1
    columns = np.array(found, np.float64).reshape(-1, 4).T
    return PhotographDifferences(columns[0].astype(np.int8), columns[1].astype(np.int32), columns[2], columns[3])


def strips_of(block: Block, photos: Photos) -> dict[str, int]:
    """The strip of each photograph: those that follow each other in time, or in the order of their names, in one direction."""
    times = {photo.name: photo.time or "" for photo in photos.photos}
    names = sorted(block.names, key=lambda name: (times.get(name, ""), name))
    centres = np.array([block.of(name).centre[:2] for name in names])
    moves = np.diff(centres, axis=0)
    moves /= np.maximum(np.hypot(*moves.T), 1e-9)[:, None]
    same = np.concatenate([[False], (moves[1:] * moves[:-1]).sum(axis=1) > _ALONG, [False]])
    # A move between two strips has neither the direction of the one before nor that of the one after.
    along = same[:-1] | same[1:]
    strip, out = 0, {}
    for k, name in enumerate(names):
        strip += int(k > 0 and not along[k - 1])
        out[name] = strip
    return out


def _spread(rays: ImageResiduals, points: GroundPoints, names: list[str], known: set[str]) -> Iterator[_Point]:
    """Tie points with three rays or more in photographs whose precision is known, evenly over all of them."""
    used = rays.used & (rays.track >= 0)
    track, photo = rays.track[used], rays.photo[used]
    pixels = np.column_stack([rays.col[used], rays.row[used]])
    places, order = np.column_stack([points.x, points.y, points.z]), np.argsort(points.track)
    at = np.clip(np.searchsorted(points.track, track, sorter=order), 0, max(len(places) - 1, 0))
    starts = np.flatnonzero(np.diff(track, prepend=-1))
    ends = np.append(starts[1:], len(track))
    many = np.flatnonzero(ends - starts > _FEWEST)
    # In steps of the golden section all parts of the block have had their turn, however soon enough points are found.
    turns = many[np.argsort((np.arange(len(many)) * 0.6180339887498949) % 1.0, kind="stable")]
    for k in turns:
        rows, row = slice(starts[k], ends[k]), order[at[starts[k]]] if len(places) else -1
        own = {names[p]: pixel for p, pixel in zip(photo[rows].tolist(), pixels[rows], strict=True) if names[p] in known}
        if row >= 0 and points.track[row] == track[starts[k]] and len(own) > _FEWEST:
            yield _Point(places[row], own)


_Found = Iterator[tuple[tuple[str, ...], np.ndarray, WeighedRays]]


def _between_strips(point: _Point, strip_of: dict[str, int], covariance: StoredCovariance, views: dict[str, View]) -> _Found:
    by_strip: dict[int, list[str]] = {}
    for name in sorted(point.pixels):
        by_strip.setdefault(strip_of[name], []).append(name)
    sides = [names for _, names in sorted(by_strip.items()) if len(names) >= _FEWEST]
    for first, second in combinations(sides, 2):
        here, there = (covariance.rays_of(point.place, [views[name] for name in names]) for names in (first, second))
        places = [_intersected(point, [views[name] for name in names]) for names in (first, second)]
        yield (*first, "|", *second), places[0] - places[1], here.plus(there, -1.0)


def _left_out(point: _Point, strip_of: dict[str, int], covariance: StoredCovariance, views: dict[str, View]) -> _Found:
    names = sorted(point.pixels)
    # One photograph of each point, another one of the next: all of them would say the same twice.
    out = names[int(abs(point.place[0] * 1e3)) % len(names)]
    others = [name for name in names if name != out]
    place = _intersected(point, [views[name] for name in others])
    ray = covariance.ray_past(place, views[out], covariance.rays_of(place, [views[name] for name in others]))
    yield (out,), views[out].project(place[None])[0] - point.pixels[out], ray


def _intersected(point: _Point, views: list[View]) -> np.ndarray:
    """The point (3,) m from the rays of some of its photographs, by least squares from where all of them have it."""
    place = point.place
    for _ in range(3):
        moves = [by_point(view, place) for view in views]
        off = [point.pixels[view.name] - view.project(place[None])[0] for view in views]
        place = place + np.linalg.lstsq(np.concatenate(moves), np.concatenate(off), rcond=None)[0]
    return place
