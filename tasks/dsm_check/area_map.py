"""The suspicious areas as polygons on a map: GeoJSON (RFC 7946), in longitude and latitude, or on a plane of its own in X and Y.

Blocks of cells have rectangular outlines; an area is the outline of its blocks, with holes.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict
from pyproj import CRS, Transformer

from orthomill.schemas.job import Table
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.dsm_check.areas import SuspiciousArea
from orthomill.tasks.dsm_check.difference_words import ERRORS, AreaWords
from orthomill.tasks.geometry.reference_system import ground_crs, on_earth

Ring = tuple[tuple[float, float], ...]


class AreaPolygon(BaseModel):
    """Rings of longitude and latitude, the outline first."""

    model_config = ConfigDict(frozen=True)

    type: Literal["MultiPolygon"] = "MultiPolygon"
    coordinates: tuple[tuple[Ring, ...], ...]


class AreaFeature(BaseModel):
    """One area with its figures: place (m, in the project's system), size (m2), mean and largest correction (m)."""

    model_config = ConfigDict(frozen=True)

    type: Literal["Feature"] = "Feature"
    geometry: AreaPolygon
    properties: dict[str, float | str]


class AreaMap(BaseModel):
    """All areas, the largest volume first."""

    model_config = ConfigDict(frozen=True)

    type: Literal["FeatureCollection"] = "FeatureCollection"
    features: tuple[AreaFeature, ...] = ()


AREA_MAP = Table("dsm_check/areas.json", AreaMap)


@dataclass(frozen=True)
class AreaRule:
    """The blocks of the coarse raster, the system of its grid, and what differences are called."""

    grid: MapGrid
    size: int
    crs: str
    words: AreaWords = ERRORS


def area_map(areas: list[SuspiciousArea], rule: AreaRule) -> AreaMap:
    """The areas as polygons."""
    change = Transformer.from_crs(ground_crs(rule.crs), CRS.from_epsg(4326), always_xy=True) if on_earth(rule.crs) else None
    return AreaMap(features=tuple(_feature(area, rule, change) for area in areas))


def _feature(area: SuspiciousArea, rule: AreaRule, change: Transformer | None) -> AreaFeature:
    polygons = tuple(tuple(_on_earth(ring, rule, change) for ring in rings) for rings in outlines(area.blocks))
    figures: dict[str, float | str] = {
        rule.words.column.split()[0]: rule.words.side(area.dh),
        "mean_correction_m": round(area.dh, 3),
        "largest_correction_m": round(area.extreme, 3),
        "area_m2": round(area.area, 1),
        "x": round(area.x, 2),
        "y": round(area.y, 2),
    }
    return AreaFeature(geometry=AreaPolygon(coordinates=polygons), properties=figures)


def _on_earth(corners: np.ndarray, rule: AreaRule, change: Transformer | None) -> Ring:
    side = rule.size * rule.grid.cell
    x, y = rule.grid.west + corners[:, 1] * side, rule.grid.north - corners[:, 0] * side
    if change is not None:
        x, y = change.transform(x, y)
    return tuple(zip(np.round(x, 8).tolist(), np.round(y, 8).tolist(), strict=True))


def outlines(blocks: np.ndarray) -> list[list[np.ndarray]]:
    """Closed rings (N, 2) of corners (row, col) around blocks (M, 2) (row, col): one list for each outline, holes after it.

    Outlines run anticlockwise on the map and holes clockwise, as GeoJSON wants them.
    """
    inside = {(int(row), int(col)) for row, col in blocks}
    following: dict[tuple[int, int], list[tuple[int, int]]] = {}
    # Every side of a block without a neighbour is an edge, with the block to its left on the map (rows run south).
    for row, col in sorted(inside):
        sides = (
            ((row + 1, col), (row + 1, col + 1), (row + 1, col)),
            ((row + 1, col + 1), (row, col + 1), (row, col + 1)),
            ((row, col + 1), (row, col), (row - 1, col)),
            ((row, col), (row + 1, col), (row, col - 1)),
        )
        for start, end, neighbour in sides:
            if neighbour not in inside:
                following.setdefault(start, []).append(end)
    rings = []
    while following:
        rings.append(_ring(following))
    outer = [ring for ring in rings if _turn(ring) < 0]
    return [[ring, *(hole for hole in rings if _turn(hole) > 0 and _around(ring, hole))] for ring in outer]


def _ring(following: dict[tuple[int, int], list[tuple[int, int]]]) -> np.ndarray:
    start = next(iter(following))
    ring, here, came = [start], start, (0, 0)
    while True:
        # Where two blocks meet at a corner, the sharper left turn keeps their outlines apart.
        ends = following[here]
        end = min(ends, key=lambda e: came[1] * (e[0] - here[0]) - came[0] * (e[1] - here[1]) if came != (0, 0) else 0)
        ends.remove(end)
        if not ends:
            del following[here]
        came, here = (end[0] - here[0], end[1] - here[1]), end
        ring.append(here)
        if here == start:
            return _without_straight(np.array(ring))


def _without_straight(ring: np.ndarray) -> np.ndarray:
    """A closed ring without corners at which it goes straight on."""
    steps = np.diff(ring, axis=0)
    bend = (steps != np.roll(steps, 1, axis=0)).any(axis=1)
    corners = ring[:-1][bend]
    return np.concatenate([corners, corners[:1]])


def _turn(ring: np.ndarray) -> float:
    """Twice the signed area of a closed ring of (row, col): negative where it runs anticlockwise on the map."""
    row, col = ring[:-1].T.astype(float)
    return float(np.dot(row, np.roll(col, -1)) - np.dot(col, np.roll(row, -1))) * -1.0 if len(ring) else 0.0


def _around(outer: np.ndarray, hole: np.ndarray) -> bool:
    """Whether an outline holds the first block inside a hole's corner."""
    row, col = hole[0] + 0.25
    inside = False
    for (r0, c0), (r1, c1) in pairwise(outer):
        if (r0 > row) != (r1 > row) and col < c0 + (row - r0) * (c1 - c0) / (r1 - r0):
            inside = not inside
    return inside
