"""Surveyed points carried from their own reference system to the project's, heights included where both state them.

Where only one of the two systems states what heights count from, heights keep their number, for nothing can be known: the caller
gets a sentence. Where both do, PROJ must have the geoid's grid; without it the answer would be wrong by tens of metres in silence.
"""

from itertools import product

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.geometry.reference_system import ground_crs

_NEAR = 20_000.0
"""m: points within this distance of the photographs belong to the same site"""


def survey_crs(text: str) -> CRS:
    """A reference system of surveyed points: anything that PROJ knows, degrees and feet too. Raises WorkflowError."""
    for words in _spellings(text):
        try:
            return CRS.from_user_input(words)
        except CRSError:
            continue
    raise WorkflowError(
        f"The reference system '{text}' of the control points is not known to PROJ; name it like EPSG:32634, EPSG:4326, "
        "EPSG:2100+5773 or as a PROJ string."
    )


def _spellings(text: str) -> list[str]:
    """As it stands, and OpenDroneMap's own "WGS84 UTM 16N"."""
    words = text.strip().upper().split()
    if len(words) == 3 and words[:2] == ["WGS84", "UTM"] and words[2][:-1].isdigit() and words[2][-1] in "NS":
        return [f"EPSG:{(32600 if words[2][-1] == 'N' else 32700) + int(words[2][:-1])}"]
    return [text.strip()]


def vertical_name(text: str) -> str | None:
    """What heights in a reference system count from; None when it does not say."""
    crs = survey_crs(text)
    if crs.is_compound:
        return crs.sub_crs_list[1].name
    return f"ellipsoid of {crs.name}" if len(crs.axis_info) == 3 else None


def carried(points: np.ndarray, source: str, target: str) -> tuple[np.ndarray, str | None]:
    """Points (N, 3), east or longitude first, from one system to the other, and a sentence when heights kept their number.

    Raises WorkflowError when a grid that the heights need is not installed, or a point cannot be carried.
    """
    start, end = survey_crs(source), CRS.from_user_input(target)
    heights = (vertical_name(source), vertical_name(target))
    if start.equals(end):
        return points, None
    if all(heights):
        return _carried_whole(points, start, end, source, target), None
    transformer = Transformer.from_crs(_plane(start), ground_crs(target), always_xy=True)
    x, y = transformer.transform(points[:, 0], points[:, 1])
    out = np.column_stack([x, y, points[:, 2]])
    _check_finite(out, source, target)
    stated = {(True, False): source, (False, True): target}.get((heights[0] is not None, heights[1] is not None))
    sentence = f"Heights of control keep their number: only {stated} says what they count from." if stated else None
    return out, sentence


def _plane(crs: CRS) -> CRS:
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def _carried_whole(points: np.ndarray, start: CRS, end: CRS, source: str, target: str) -> np.ndarray:
    group = TransformerGroup(start, end, always_xy=True)
    if not group.best_available or not group.transformers:
        grids = [grid for operation in group.unavailable_operations for grid in operation.grids]
        missing = sorted({grid.short_name for grid in grids if not grid.available})
        raise WorkflowError(
            f"Heights cannot be carried from {source} to {target}: PROJ lacks the grid {', '.join(missing[:3]) or 'for it'}. "
            "Install it (projsync), or give control with heights of the project's own system."
        )
    out = np.column_stack(group.transformers[0].transform(*points.T))
    _check_finite(out, source, target)
    return out


def _check_finite(points: np.ndarray, source: str, target: str) -> None:
    if not np.isfinite(points).all():
        raise WorkflowError(
            f"Control points cannot be carried from {source} to {target}: their numbers lie outside of it. State the reference "
            "system that they were surveyed in."
        )


def where_they_would_lie(points: np.ndarray, source: str, target: str, site: np.ndarray) -> str | None:
    """Why points (N, 3), read as `source`, may lie far from `site` (2,) on the map of `target`, as the end of a sentence: the
    system or the order of axes that would bring them there; None when nothing common does."""
    to_degrees = Transformer.from_crs(ground_crs(target), CRS.from_epsg(4326), always_xy=True)
    longitude, latitude = to_degrees.transform(*site)
    zone = int((longitude + 180.0) // 6.0) + 1
    utm = [f"EPSG:{(32600 if latitude >= 0 else 32700) + z}" for z in (zone, zone - 1, zone + 1) if 1 <= z <= 60]
    for name, swapped in product([source, target, "EPSG:4326", *utm, "EPSG:3857"], (False, True)):
        xy = points[:, [1, 0]] if swapped else points[:, :2]
        if _median_distance(xy, name, target, site) < _NEAR:
            order = "with X and Y exchanged" if swapped and name != "EPSG:4326" else ""
            order = "with latitude before longitude" if swapped and name == "EPSG:4326" else order
            return " ".join(word for word in ("" if name == source else f"in {name}", order) if word)
    return None


def _median_distance(xy: np.ndarray, name: str, target: str, site: np.ndarray) -> float:
    try:
        transformer = Transformer.from_crs(CRS.from_user_input(name), ground_crs(target), always_xy=True)
        moved = np.column_stack(transformer.transform(*xy.T))
    except ProjError:
        return np.inf
    distance = np.linalg.norm(moved - site, axis=1)
    return float(np.median(distance)) if np.isfinite(distance).all() else np.inf
