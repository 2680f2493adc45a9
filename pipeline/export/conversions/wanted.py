"""How a product is wanted: for the command line too, which loads nothing that reads files."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Wanted:
    """Another reference system, area (west, south, east, north in that system), cell (in its units); None: all of it, the cell of
    the product."""

    crs: str | None = None
    area: tuple[float, float, float, float] | None = None
    cell: float | None = None
    cutline: Path | None = None
    """file of polygons; what lies outside them is left out"""
