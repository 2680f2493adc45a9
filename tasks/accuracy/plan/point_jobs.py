"""A job for each check point, the statement that follows from all of them, and the report."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from orthomill.schemas.accuracy.accuracy_statement import STATEMENT
from orthomill.schemas.accuracy.adjustment_statement import (
    ADJUSTMENT_STATEMENT,
    EXTERIOR_PRECISION,
    INTERIOR_CORRELATION,
    SURVEYED_RELIABILITY,
)
from orthomill.schemas.accuracy.point_tests import POINT_TESTS, point_table
from orthomill.schemas.accuracy.promised_errors import (
    PHOTOGRAPH_DIFFERENCES,
    RELIABILITY,
    PairDifferences,
    pair_differences_table,
    promised_heights_table,
)
from orthomill.schemas.bare_ground import TERRAIN, TERRAIN_PRECISION
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import Job, Raster, Reading, Table
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.observations import CONTROL, GROUND_POINTS, IMAGE_RESIDUALS, ControlPoint
from orthomill.schemas.orientation import BLOCK, BLOCK_PRECISION, GROUND_RESIDUALS, Block
from orthomill.schemas.photo import PHOTOS, Photos, photo_raster
from orthomill.schemas.raster import MapGrid, Tile, Window, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.surface import CORRECTED, DATUM_PRECISION, HEIGHT, ORTHO, PRECISION, PROVENANCE, SURFACE, points_table
from orthomill.tasks.accuracy.adjustment.adjustment_statement_of import state_adjustment
from orthomill.tasks.accuracy.points.orthoimage_place import pixels_around
from orthomill.tasks.accuracy.points.point_patches import patches_of
from orthomill.tasks.accuracy.points.point_test import PointPlace, PointRules, point_beside_products
from orthomill.tasks.accuracy.points.surface_height import cells_around
from orthomill.tasks.accuracy.points.testable_heights import TestablePart, promised_heights
from orthomill.tasks.accuracy.points.under_vegetation import under_vegetation
from orthomill.tasks.accuracy.promises.disjoint_pairs import CheckedPart, pair_differences
from orthomill.tasks.accuracy.promises.disjoint_photographs import photograph_differences
from orthomill.tasks.accuracy.promises.kept_promises import reliability_of
from orthomill.tasks.accuracy.statement.point_statement import collect_tests, statement_of

_SCRATCH = 64 * MIB
"""bytes for patches and matching of one point"""


@dataclass(frozen=True)
class PointJobs:
    """The jobs about the check points of a project."""

    view: ProjectView
    steepest: float
    vegetated: tuple[str, ...]

    def jobs(self) -> Iterator[Job]:
        """A test of each check point, then the statement. Raises WorkflowError for names under vegetation that no point has."""
        tables: list[Table] = []
        for number, point in enumerate(self.points):
            tables.append(point_table(number))
            yield self._test(number, point, tables[-1])
        promised = [self._promised(tile) for tile in self._surface_tiles()]
        yield from promised
        area = self.surface.cells * self.surface.cell**2 / 1e6 if self.surface else 0.0
        yield Job(
            stage="accuracy",
            item="points",
            function=collect_tests,
            reads={
                "tests": tuple(tables),
                "ground": GROUND_RESIDUALS,
                "promised": tuple(promised_heights_table(job.row, job.col) for job in promised),
            },
            writes={"tests": POINT_TESTS},
            params={"area_km2": area},
        )
        tiles = list(self._tiles())
        yield from map(self._pairs, tiles)
        differences: tuple[Table[PairDifferences], ...] = tuple(pair_differences_table(tile.row, tile.col) for tile in tiles)
        yield Job(
            stage="accuracy",
            item="photographs",
            function=photograph_differences,
            reads={"block": BLOCK, "rays": IMAGE_RESIDUALS, "points": GROUND_POINTS, "photos": PHOTOS},
            writes={"differences": PHOTOGRAPH_DIFFERENCES},
        )
        yield Job(
            stage="accuracy",
            item="reliability",
            function=reliability_of,
            reads={"tests": POINT_TESTS, "ground": GROUND_RESIDUALS, "pairs": differences, "photographs": PHOTOGRAPH_DIFFERENCES},
            writes={"reliability": RELIABILITY},
        )
        yield Job(
            stage="accuracy",
            item="adjustment",
            function=state_adjustment,
            reads={"block": BLOCK, "ground": GROUND_RESIDUALS, "precision": BLOCK_PRECISION},
            writes={
                "statement": ADJUSTMENT_STATEMENT,
                "exterior": EXTERIOR_PRECISION,
                "interior": INTERIOR_CORRELATION,
                "surveyed": SURVEYED_RELIABILITY,
            },
        )
        yield Job(
            stage="accuracy", item="statement", function=statement_of, reads={"tests": POINT_TESTS}, writes={"statement": STATEMENT}
        )

    @cached_property
    def points(self) -> tuple[ControlPoint, ...]:
        """The check points of the control files; none where the surface stands on a plane in space, in a system of its own."""
        if self.view.project.grid.kind == "plane":
            return ()
        return tuple(point for point in self.view.table(CONTROL).points if point.role == "check")

    @cached_property
    def under(self) -> frozenset[str]:
        """The check points under vegetation. Raises WorkflowError for a pattern of `vegetated` that none has."""
        return under_vegetation((point.name for point in self.points), self.vegetated)

    @cached_property
    def block(self) -> Block:
        """The oriented photographs."""
        return self.view.table(BLOCK)

    @cached_property
    def photos(self) -> Photos:
        """What is known of the photographs."""
        return self.view.table(PHOTOS)

    @cached_property
    def surface(self) -> MapGrid | None:
        """The grid of the surface model, if one is made."""
        return self.view.table(SURFACE).grid if self.view.has_stage("densification") else None

    @cached_property
    def ortho(self) -> MapGrid | None:
        """The grid of the orthoimage, if one is made."""
        if not self.view.has_stage("texture"):
            return None
        spec = self.view.raster(ORTHO)
        cell, _, west, _, _, north = spec.transform or (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
        return MapGrid(west=west, north=north, cell=cell, rows=spec.shape[0], cols=spec.shape[1])

    def _tiles(self) -> Iterator[Tile]:
        """Of the surface model, where pairs of photographs measured it."""
        if self.surface and self.view.has_stage("epipolar"):
            yield from tiles_of(self.surface.shape, self.view.project.tile)

    def _surface_tiles(self) -> Iterator[Tile]:
        """Of the surface model, where there are points to test it."""
        if self.surface and self.points:
            yield from tiles_of(self.surface.shape, self.view.project.tile)

    def _promised(self, tile: Tile) -> Job:
        assert self.surface, "tiles are those of the surface"
        part = TestablePart(self.surface, tile.window, self.steepest)
        return Job(
            stage="accuracy",
            item="promised",
            function=promised_heights,
            reads={"heights": tuple(Raster(name, part.read) for name in (HEIGHT, PRECISION, PROVENANCE, DATUM_PRECISION))},
            writes={"promised": promised_heights_table(tile.row, tile.col)},
            params={"part": part},
            row=tile.row,
            col=tile.col,
        )

    def _pairs(self, tile: Tile) -> Job:
        assert self.surface, "tiles are those of the surface"
        window = tile.window.grown(1).clipped(self.surface.shape)
        heights = CORRECTED if self.view.has_stage("dsm_check") else HEIGHT
        return Job(
            stage="accuracy",
            item="pairs",
            function=pair_differences,
            reads={"points": points_table(tile.row, tile.col), "heights": Raster(heights, window), "pairs": PAIRS},
            writes={"differences": pair_differences_table(tile.row, tile.col)},
            params={"part": CheckedPart(self.surface, window)},
            row=tile.row,
            col=tile.col,
            scratch=array_bytes(120, window),
        )

    def _test(self, number: int, point: ControlPoint, table: Table) -> Job:
        place = self._place(point)
        heights, pixels = place.cells, place.pixels
        own = (HEIGHT, PRECISION, PROVENANCE, DATUM_PRECISION) if heights else ()
        checked = (CORRECTED,) if heights and self.view.has_stage("dsm_check") else ()
        ground = (TERRAIN, TERRAIN_PRECISION) if heights and self.view.has_stage("terrain") else ()
        reads: dict[str, Reading] = {
            "heights": tuple(Raster(name, heights) for name in own if heights),
            "corrected": tuple(Raster(name, heights) for name in checked if heights),
            "terrain": tuple(Raster(name, heights) for name in ground if heights),
            "ortho": (Raster(ORTHO, pixels),) if pixels else (),
            "photos": tuple(Raster(photo_raster(patch.photo, patch.level), patch.window) for patch in place.patches),
            "block": BLOCK,
            "ground": GROUND_RESIDUALS,
        }
        return Job(
            stage="accuracy",
            item="point",
            function=point_beside_products,
            reads=reads,
            writes={"test": table},
            params={"point": point, "place": place, "rules": PointRules(self.steepest, point.name in self.under)},
            row=number,
            scratch=_SCRATCH,
        )

    def _place(self, point: ControlPoint) -> PointPlace:
        x, y, _ = point.xyz
        cells = _inside(cells_around(self.surface, x, y), self.surface) if self.surface else None
        pixels = _inside(pixels_around(self.ortho, x, y), self.ortho) if self.ortho else None
        patches = tuple(patches_of(point, self.block, self.photos, self.ortho.cell)) if self.ortho and pixels else ()
        return PointPlace(self.surface, cells, self.ortho, pixels, patches)


def _inside(window: Window, grid: MapGrid) -> Window | None:
    """The part of a window on a grid; None where there is none."""
    clipped = window.clipped(grid.shape)
    return None if clipped.empty else clipped
