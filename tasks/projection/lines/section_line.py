"""The line in which a plane meets the surface, for drawings: polylines in space, as DXF (R12) and GeoJSON.

Neighbouring triangles have bitwise the same corners, so their segments have the same ends: these are chained into polylines.
"""

import json
from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, model_validator

from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.projection.lines.sections import Point, section_lines

_SAME = 1e-6  # m: ends that are one point; corners are float32, of micrometres


class SectionLine(Settings):
    """A plane through the surface; its line is exported as DXF and GeoJSON."""

    name: str = setting("section", "Name of its files.", pattern=r"^[a-z][a-z0-9_]*$")
    point: Point = setting(..., "A point of the plane.", "m")
    normal: Point = setting(..., "Across the plane; of any length.")

    @model_validator(mode="after")
    def _has_a_direction(self) -> "SectionLine":
        if not any(self.normal):
            raise ValueError("the normal of a section line is (0, 0, 0); give a direction across the plane")
        return self


class LineText(BaseModel):
    """A drawing as text."""

    model_config = ConfigDict(frozen=True)

    text: str


class DrawnSection(NamedTuple):
    """The same line in two formats."""

    dxf: LineText
    geojson: LineText


def draw_section(blocks: Iterator[np.ndarray], census: MeshCensus, line: SectionLine) -> DrawnSection:
    """The line of a plane on all blocks of a mesh."""
    point, normal = np.array(line.point) - census.origin, np.array(line.normal)
    found = [section_lines(known(block), point, normal) for block in blocks]
    lines = [polyline + census.origin for polyline in chained(np.concatenate([np.zeros((0, 2, 3)), *found]))]
    return DrawnSection(LineText(text=as_dxf(lines, line.name)), LineText(text=as_geojson(lines, line.name)))


def known(block: np.ndarray) -> np.ndarray:
    """The triangles (T, 3, 3) of a block, without the filling behind the last one."""
    corners = block.reshape(-1, 3, 3).astype(np.float64)
    return corners[np.isfinite(corners[:, 0, 0])]


def chained(segments: np.ndarray) -> list[np.ndarray]:
    """Polylines (N, 3) of segments (S, 2, 3) with common ends; a closed one ends where it begins."""
    ends = np.round(segments / _SAME).astype(np.int64)
    keys = [(tuple(a), tuple(b)) for a, b in ends.tolist()]
    meeting: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for number, (a, b) in enumerate(keys):
        if a != b:
            meeting[a].append(number)
            meeting[b].append(number)
    used, lines = np.array([a == b for a, b in keys], bool), []
    # Open lines first, from their ends: a closed one has none and may begin anywhere.
    starts = [place for place, found in meeting.items() if len(found) != 2] + list(meeting)
    for start in starts:
        while (line := _followed(start, keys, meeting, used)) is not None:
            lines.append(np.array(line, np.float64) * _SAME)
    return lines


def _followed(start: tuple, keys: list, meeting: dict, used: np.ndarray) -> list | None:
    """Places from `start` on, over segments that are not used yet; None where there is none."""
    line, place = [start], start
    while True:
        ahead = next((number for number in meeting[place] if not used[number]), None)
        if ahead is None:
            return line if len(line) > 1 else None
        used[ahead] = True
        a, b = keys[ahead]
        place = b if a == place else a
        line.append(place)


def as_dxf(lines: list[np.ndarray], layer: str) -> str:
    """Polylines in space as a DXF file (R12), which every CAD program reads."""
    rows = ["0", "SECTION", "2", "ENTITIES"]
    for line in lines:
        rows += ["0", "POLYLINE", "8", layer, "66", "1", "70", "8", "10", "0.0", "20", "0.0", "30", "0.0"]
        for x, y, z in line.tolist():
            rows += ["0", "VERTEX", "8", layer, "10", f"{x:.6f}", "20", f"{y:.6f}", "30", f"{z:.6f}", "70", "32"]
        rows += ["0", "SEQEND", "8", layer]
    return "\n".join([*rows, "0", "ENDSEC", "0", "EOF", ""])


def as_geojson(lines: list[np.ndarray], name: str) -> str:
    """Polylines in space as GeoJSON, in the coordinates of the project."""
    shape = {"type": "MultiLineString", "coordinates": [np.round(line, 6).tolist() for line in lines]}
    feature = {"type": "Feature", "properties": {"name": name}, "geometry": shape}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}) + "\n"
