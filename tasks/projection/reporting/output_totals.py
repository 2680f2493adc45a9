"""An output and the sums over its tiles: what the report and its doubts are made from."""

from dataclasses import dataclass

from orthomill.schemas.solid.frames import AnyFrame
from orthomill.tasks.colouring.surface_colours import ProjectionTile


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
        return self.facts.frame.name

    @property
    def seen(self) -> tuple[int, ...]:
        """Pixels that 0, 1, 2, 3 or more photographs see."""
        return tuple(sum(tile.seen[k] for tile in self.tiles) for k in range(4))

    @property
    def coloured(self) -> float:
        """Part of the surface that has a colour."""
        return self.sum("coloured") / max(self.sum("surface"), 1)

    @property
    def difference(self) -> float | None:
        """Mean difference of the blended colours from their mean, grey levels."""
        return self.sum("difference_sum") / self.sum("difference_count") if self.sum("difference_count") else None
