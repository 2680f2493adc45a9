"""The surface with the orthoimage on it: one GLB, or 3D Tiles with levels of detail.

What a part is in the file is made by the methods that are handed in. Coordinates are metres from an origin, which file and tileset
name; in 3D Tiles the root leads from there to geocentric coordinates, heights taken as ellipsoidal.

Source: OGC 22-025r4, 3D Tiles 1.1; Khronos, glTF 2.0.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orthomill.pipeline.export.solids.height_tiles import HeightTiles, TilePlace
from orthomill.schemas.errors import WorkflowError

MOST_PARTS = 64
"""of one GLB: about two million triangles, what a browser shows at ease"""
_DEEP = 0.5
"""cells by which the border of a tile hangs down, and by which a level is taken to deviate"""


@dataclass(frozen=True)
class SolidMethods:
    """`patch` makes a part of heights, cell, corner, picture and skirt (None: nothing is left), `glb` a file of parts and what is
    known of them, `earth` the 4 x 4 matrix from the origin to geocentric coordinates (None: nowhere on the earth)."""

    patch: Callable[..., Any]
    glb: Callable[[Sequence[Any], dict[str, Any]], bytes]
    earth: Callable[[str, np.ndarray], np.ndarray | None]


def write_glb(path: Path, tiles: HeightTiles, methods: SolidMethods) -> None:
    """One file of the finest level that is not too large. Raises WorkflowError where there is no height."""
    level = next(level for level in range(tiles.top + 1) if len(list(tiles.places(level))) <= MOST_PARTS or level == tiles.top)
    origin = _origin(tiles)
    parts = [part for place in tiles.places(level) if (part := _part(tiles, place, origin, 0.0, methods)) is not None]
    if not parts:
        raise _nothing()
    path.write_bytes(methods.glb(parts, _about(tiles, origin)))


def write_tileset(path: Path, tiles: HeightTiles, methods: SolidMethods) -> None:
    """A folder with tileset.json and a GLB for each tile. Raises WorkflowError where there is no height."""
    (path / "tiles").mkdir(parents=True)
    origin = _origin(tiles)
    (top,) = tiles.places(tiles.top)
    root = _node(path, tiles, top, origin, methods)
    if root is None:
        raise _nothing()
    matrix = methods.earth(tiles.crs, origin)
    size = float(np.linalg.norm(root["boundingVolume"]["box"][3::4])) * 2
    content = {
        "asset": {"version": "1.1", "generator": "orthomill", "extras": _about(tiles, origin)},
        "geometricError": size,
        "root": {**({} if matrix is None else {"transform": matrix.T.ravel().tolist()}), **root},
    }
    (path / "tileset.json").write_text(json.dumps(content, indent=1) + "\n")


def _nothing() -> WorkflowError:
    return WorkflowError("No height lies in the area or cutline that is asked for.")


def _origin(tiles: HeightTiles) -> np.ndarray:
    """A round place in the middle, at height 0, so that heights keep their values."""
    bounds = tiles.heights[0].bounds
    return np.array([np.round((bounds.left + bounds.right) / 2), np.round((bounds.bottom + bounds.top) / 2), 0.0])


def _about(tiles: HeightTiles, origin: np.ndarray) -> dict[str, Any]:
    return {"crs": tiles.crs, "origin": origin.tolist()}


def _part(tiles: HeightTiles, place: TilePlace, origin: np.ndarray, skirt: float, methods: SolidMethods) -> Any:
    tile = tiles.read(place)
    if tile is None:
        return None
    return methods.patch(tile.heights, tile.cell, np.array([*tile.corner, 0.0]) - origin, tile.picture, skirt)


def _node(path: Path, tiles: HeightTiles, place: TilePlace, origin: np.ndarray, methods: SolidMethods) -> dict[str, Any] | None:
    """A tile and all below it, written; None where they have no height."""
    error = _DEEP * float(tiles.heights[place.level].transform.a)
    part = _part(tiles, place, origin, error, methods)
    below = (_node(path, tiles, child, origin, methods) for child in tiles.children(place))
    children = [node for node in below if node is not None]
    if part is None and not children:
        return None
    name = f"tiles/{place.level}-{place.row}-{place.col}.glb"
    boxes = [np.array(node["boundingVolume"]["box"]) for node in children]
    low = [box[:3] - box[3::4] for box in boxes] + ([] if part is None else [part.vertices.min(axis=0)])
    high = [box[:3] + box[3::4] for box in boxes] + ([] if part is None else [part.vertices.max(axis=0)])
    middle, half = (np.max(high, axis=0) + np.min(low, axis=0)) / 2, (np.max(high, axis=0) - np.min(low, axis=0)) / 2
    own: dict[str, Any] = {
        "boundingVolume": {"box": [*middle.tolist(), *np.diag(half).ravel().tolist()]},
        "geometricError": error if place.level else 0.0,
        "refine": "REPLACE",
    }
    if part is not None:
        (path / name).write_bytes(methods.glb([part], _about(tiles, origin)))
        own["content"] = {"uri": name}
    return {**own, "children": children} if children else own
