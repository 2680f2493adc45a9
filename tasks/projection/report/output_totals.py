"""An output and the sums over its tiles: what the report and its doubts are made from."""

from dataclasses import dataclass
from functools import cached_property

from orthomill.schemas.solid.frames import AnyFrame
from orthomill.tasks.colouring.blending.colour_sums import ColourSums, sum_of
from orthomill.tasks.projection.tiles.output_colours import ProjectionTile


@dataclass(frozen=True)
class OutputFacts:
    """An output, its number of tiles, and the side of its pixel on the surface, m."""

    frame: AnyFrame
    tiles: int
    pixel: float
    before: float = 90.0
    """by how many degrees photographs stand before its plane at most"""
    cut: bool = False
    """whether a section cuts the surface"""
    only: str | None = None
    """the one photograph that it is to show, with holes where that sees nothing"""


@dataclass(frozen=True, eq=False)
class OutputTotals:
    """Sums over the tiles of an output."""

    facts: OutputFacts
    tiles: tuple[ProjectionTile, ...]

    def sum(self, field: str) -> float:
        """Of a number of the tiles."""
        return sum(getattr(tile, field) for tile in self.tiles)

    @property
    def name(self) -> str:
        """Of the output."""
        return self.facts.frame.name

    @cached_property
    def colours(self) -> ColourSums:
        """Sums over its surface."""
        return sum_of(tile.colours for tile in self.tiles)

    @property
    def coloured(self) -> float:
        """Part of the surface that has a colour."""
        return self.sum("coloured") / max(self.sum("surface"), 1)
