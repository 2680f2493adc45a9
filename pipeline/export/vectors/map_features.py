"""Features on the map, as every format of vectors takes them."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from orthomill.schemas.maps.map_lines import MapLines

Kind = Literal["point", "line", "area"]
_GEOMETRY = ("line", "x", "y", "z")
_DRAWING = ("layer", "dashed", "text")


@dataclass(frozen=True)
class Feature:
    """A point (1, 3), a line (N, 3), or the closed outline of an area (N, 3): X, Y, Z in m; its attributes by name."""

    places: np.ndarray
    attributes: dict[str, str | int | float | bool | None]
    layer: str = ""
    dashed: bool = False
    text: str = ""
    holes: tuple[np.ndarray, ...] = ()
    """closed outlines (N, 3) inside that of an area"""


@dataclass(frozen=True)
class Layer:
    """Features of one kind with the same attributes."""

    name: str
    kind: Kind
    features: Iterable[Feature]
    """gone through several times: those of a large map are read anew each time"""


@dataclass(frozen=True)
class TableLines:
    """The lines of many tables, of which one is in memory at a time: `read` gives that of a place in their order."""

    number: int
    read: Callable[[int], MapLines]

    def __iter__(self) -> Iterator[Feature]:
        for place in range(self.number):
            yield from line_features(self.read(place))


def line_features(table: MapLines) -> Iterator[Feature]:
    """The lines of a table."""
    names = [f.name for f in fields(table) if f.name not in (*_GEOMETRY, *_DRAWING)]
    starts = np.flatnonzero(np.diff(table.line, prepend=-1)) if len(table) else np.zeros(0, np.int64)
    places = np.column_stack([table.x, table.y, table.z])
    for first, last in zip(starts, [*starts[1:], len(table)], strict=False):
        attributes = {name: _plain(getattr(table, name)[first]) for name in names}
        drawing = {name: _plain(getattr(table, name)[first]) for name in _DRAWING}
        yield Feature(places[first:last], attributes, str(drawing["layer"]), bool(drawing["dashed"]), str(drawing["text"]))


def _plain(value: Any) -> Any:
    """A value of a column as Python's own: a stored table has columns of text, a new one has NumPy's."""
    return value.item() if isinstance(value, np.generic) else value
