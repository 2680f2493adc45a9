"""The jobs that compare pairs without a common photograph, on squares that are spread evenly over the block."""

from collections.abc import Iterator

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.job import Job, Table
from orthomill.schemas.raster import Window
from orthomill.tasks.densification.difference_square import REACH, square_differences, square_scratch
from orthomill.tasks.densification.plan.surface_jobs import SurfacePlan, SurfaceSource, pieces_of, surface_tile, tile_reads
from orthomill.tasks.densification.precision.pair_differences import MatchingDifferences, sum_differences

DIFFERENCES = Table("densification/differences.json", MatchingDifferences)
_SIDE, _APART, _MOST = 96, 256, 6
"""cells along the side of a square and from one to the next, at least, and squares along a side of the block, at most: what they
show is worth no more than a few per cent of what the surface costs"""


def difference_plan(plan: SurfacePlan, source: SurfaceSource, pairs: tuple[EpipolarPair, ...]) -> Iterator[Job]:
    """What the standard errors of matching are worth on this block."""
    tables = []
    shape = source.surface.grid.shape
    for window in squares(shape):
        around = window.grown(REACH)
        work, pieces = around.clipped(shape), pieces_of(source, pairs, around)
        # Three photographs make no two pairs without a common one.
        if len({name for piece in pieces for name in (piece.pair.left, piece.pair.right)}) < 4:
            continue
        tables.append(Table(f"densification/differences/{window.row}-{window.col}.json", MatchingDifferences))
        yield Job(
            stage=plan.stage,
            item="differences of a square",
            function=square_differences,
            reads=tile_reads(source, work, pieces),
            writes={"differences": tables[-1]},
            params={"tile": surface_tile(source, window, work, pieces), "rules": plan.rules},
            row=window.row // _SIDE,
            col=window.col // _SIDE,
            scratch=square_scratch(pieces, work),
        )
    yield Job(
        stage=plan.stage, item="differences", function=sum_differences, reads={"parts": tuple(tables)}, writes={"sum": DIFFERENCES}
    )


def squares(shape: tuple[int, int]) -> Iterator[Window]:
    """The squares on which pairs are compared: in the middle of equal parts of the block."""
    parts = [min(max(size // _APART, 1), _MOST) for size in shape]
    for row in range(parts[0]):
        for col in range(parts[1]):
            first = _first(row, parts[0], shape[0]), _first(col, parts[1], shape[1])
            yield Window(*first, _SIDE, _SIDE).clipped(shape)


def _first(part: int, parts: int, size: int) -> int:
    return max((2 * part + 1) * size // (2 * parts) - _SIDE // 2, 0)
