"""Polygons with their holes, for cutting and as sheets, from GeoPackage or GeoJSON, in another reference system."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS, Transformer

from orthomill.pipeline.storage.features.geometry_files import Geometry, read_geometries, understood
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.maps.wanted_area import WantedArea

PIECES = 16
"""of an edge when it is transformed: a straight line of one system is bent in another"""


@dataclass(frozen=True)
class Outline:
    """A polygon: closed rings (N, 2) X, Y, the outer one first, holes after it."""

    name: str
    rings: tuple[np.ndarray, ...]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        (west, south), (east, north) = self.rings[0].min(axis=0), self.rings[0].max(axis=0)
        return float(west), float(south), float(east), float(north)

    def contains(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Which of the places (N,) lie inside: (N,) bool; by the number of edges to the east of them."""
        order = np.argsort(y, kind="stable")
        xs, ys, odd = x[order], y[order], np.zeros(len(x), bool)
        for ring in self.rings:
            for (x0, y0), (x1, y1) in pairwise(ring):
                # Half open, so that a corner between two edges counts once.
                first, last = np.searchsorted(ys, sorted((y0, y1)))
                if first < last:
                    part = slice(first, last)
                    odd[part] ^= xs[part] < x0 + (ys[part] - y0) * ((x1 - x0) / (y1 - y0))
        inside = np.zeros(len(x), bool)
        inside[order] = odd
        return inside

    def shape(self) -> dict[str, Any]:
        """As GeoJSON."""
        return {"type": "Polygon", "coordinates": [ring.tolist() for ring in self.rings]}


def read_outlines(path: Path, crs: str) -> tuple[Outline, ...]:
    """All polygons of a file in the system `crs`. Raises WorkflowError for what cannot be read or holds none."""
    geometries = read_geometries(path, {}, ".gpkg or .geojson")
    found = understood(path, lambda: tuple(moved(one, one_system, crs) for one, one_system in _outlines(geometries)))
    if not found:
        raise WorkflowError(f"{path} holds no polygon.")
    for outline in found:
        if not all(np.isfinite(ring).all() and len(ring) >= 4 for ring in outline.rings):
            raise WorkflowError(f"{path}: the polygon {outline.name} has a ring of fewer than three corners, or none in {crs}.")
    return found


def read_wanted_area(path: Path, crs: str) -> WantedArea:
    """The polygons of a file as the area that is wanted, in the plan system of `crs`. Raises WorkflowError as `read_outlines`."""
    return WantedArea(polygons=tuple(tuple(tuple(map(tuple, ring.tolist())) for ring in o.rings) for o in read_outlines(path, crs)))


def moved(outline: Outline, system: str | None, crs: str) -> Outline:
    """The outline in another system; `system`: its own, None where it is that already."""
    own, target = _plan(system or crs), _plan(crs)
    if system is None or own == target:
        return outline
    change = Transformer.from_crs(own, target, always_xy=True)
    return Outline(outline.name, tuple(np.column_stack(change.transform(*_in_pieces(ring).T)) for ring in outline.rings))


def _plan(system: str) -> CRS:
    crs = CRS.from_user_input(system)
    return crs.sub_crs_list[0] if crs.is_compound else crs


def _in_pieces(ring: np.ndarray) -> np.ndarray:
    share = np.arange(PIECES)[None, :, None] / PIECES
    points = ring[:-1, None] + share * (ring[1:] - ring[:-1])[:, None]
    return np.concatenate([points.reshape(-1, 2), ring[-1:]])


def _outlines(geometries: tuple[Geometry, ...]) -> Iterator[tuple[Outline, str | None]]:
    for one in geometries:
        if one.kind in ("Polygon", "MultiPolygon"):
            for rings in [one.coordinates] if one.kind == "Polygon" else one.coordinates:
                yield Outline(one.name, tuple(_closed(ring) for ring in rings)), one.system


def _closed(ring: Any) -> np.ndarray:
    places = np.array([place[:2] for place in ring], np.float64)
    return places if np.array_equal(places[0], places[-1]) else np.vstack([places, places[:1]])
