"""The check of the surface without reference data, tile by tile, in one pass or in several.

First the pairs that check it are selected. Every pair and tile gets two orthoimages made with the surface under test, then the
nodes at which they are compared. A tile of the result needs the nodes around it of every pair that shows it; the report is made of
the coarse blocks and counts of all tiles.

A surface from a file goes farther: it is placed by the tie points, coarse orthoimages find its shift and make a second surface,
beside which its large and narrow errors show, and the places that were corrected are checked again until nothing is asked for any
more. The engine needs no loop for that: a pass asks for the table of the one before.
"""

from collections.abc import Generator, Iterator
from typing import Any, ClassVar, Literal, NamedTuple

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import Export, HeightFile, HeightHeader, Job, Raster, Table
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CHECKED_CODE, CORRECTED, HEIGHT, PROVENANCE, SURFACE, CheckCode, Surface
from orthomill.tasks.dsm_check.area_map import AREA_MAP
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.correction_map import CorrectionNodes
from orthomill.tasks.dsm_check.coverage import CHECKED_PAIRS, CHECKED_SURFACE, choose_checked_pairs
from orthomill.tasks.dsm_check.height_correction import Correction, RayCorrection
from orthomill.tasks.dsm_check.joint_correction import BENDS
from orthomill.tasks.dsm_check.nodes import NodeMatching
from orthomill.tasks.dsm_check.plan.answer import answer_job
from orthomill.tasks.dsm_check.plan.coarse_passes import level_pairs, placing, second_surface
from orthomill.tasks.dsm_check.plan.first_pass import first_pass
from orthomill.tasks.dsm_check.plan.later_passes import later_pass
from orthomill.tasks.dsm_check.plan.passes import FILLED, Passes, counts_table
from orthomill.tasks.dsm_check.plan.round_plan import (
    CheckScene,
    Comparing,
    Reads,
    coarser,
    correction_nodes,
    node_raster,
    ortho_raster,
)
from orthomill.tasks.dsm_check.report import DETECTABLE, DH, PRECISION, TEST, Blocks, report
from orthomill.tasks.dsm_check.report_areas import CHANGES, ERRORS
from orthomill.tasks.dsm_check.rounds.finish import Finish
from orthomill.tasks.dsm_check.rounds.round_state import state_table
from orthomill.tasks.dsm_check.surfaces.checked_surface import CheckedSurface, DensifiedSurface, SurfaceFile
from orthomill.tasks.dsm_check.surfaces.foreign_grid import foreign_surface, measured_surface
from orthomill.tasks.dsm_check.surfaces.placing import PLACED, place, places
from orthomill.tasks.dsm_check.surfaces.surface_shift import NO_SHIFT, TREND, SurfaceShift, moved_grid, shift_after
from orthomill.tasks.dsm_check.surfaces.taken_surface import take_file
from orthomill.tasks.dsm_check.tile import correct_tile, take_surface

__all__ = ["DsmCheckStage", "SurfaceFile", "node_raster", "ortho_raster"]

INPUT = "dsm_check/input"
"""float32 m: the surface under test, whatever its source"""
COARSE = "dsm_check/coarse"
"""float32 (rows, cols, 5): `areas.blocks` and `areas.slopes` in blocks of cells"""
_PLACING_LEVELS = 3, 1
"""halvings of the orthoimages in which the shift of a surface from a file is found: first those that reach far"""
_MOST_LOOKS = 8
"""of which every one moves the surface by what the one before found"""
_PLACING_CELLS = 128
"""cells along the shorter side that tell a shift to centimetres"""
_FILE_ROUNDS, _FILE_LEVELS = 4, 3


class CloserLook(Settings):
    """How places are compared that an earlier round corrected: smaller windows, nodes closer together."""

    window: int = setting(7, "Side of the least-squares window.", "orthoimage pixels", ge=5, le=31)
    search_window: int = setting(7, "Side of the correlation window on orthoimages of half the size.", "px", ge=5, le=31)
    step: Literal[2, 4, 8] = setting(2, "Distance of the nodes.", "cells")


class DsmCheckStage(Stage):
    """Two orthoimages made with the surface must agree; where they do not, their shift gives the error of the height."""

    title: ClassVar[str] = "Surface model check"

    kind: Literal["dsm_check"] = "dsm_check"
    surface: CheckedSurface = setting(DensifiedSurface(), "The surface that is checked.")
    pairs: int | None = setting(None, "Pairs that check the surface, at most; null: as many as `pairs_per_place` needs.", ge=1)
    pairs_per_place: int = setting(1, "Pairs that check every place, if as many see it: one sees what another hides.", ge=1, le=12)
    pixels_per_cell: int | None = setting(
        None, "Pixels of orthoimage along a cell, 1 or 2; null: 2 where cells are coarser than the photographs.", ge=1, le=2
    )
    step: Literal[2, 4, 8, 16] = setting(4, "Distance of the nodes where the orthoimages are compared.", "cells")
    matching: NodeMatching = setting(NodeMatching(), "How the orthoimages are compared.")
    correction: Correction = setting(RayCorrection(), "How a shift becomes a height.")
    radius: float = setting(1.5, "How far the correction of a node reaches.", "steps", ge=1.25, le=8)
    apply: Literal["all", "significant", "none"] = setting(
        "significant", "Which corrections are added to the surface; below their own standard error they would add noise."
    )
    # Of a million cells three or four standard errors are exceeded by thousands without any error of the surface.
    significance: float = setting(5.0, "A correction of this many of its standard errors is significant.", "sigma", ge=1, le=10)
    levels: int | None = setting(
        None,
        "How often the orthoimages are halved, at most, for a second surface that shows large, steep and narrow errors; null: 3 "
        "times for a surface from a file, never for the one that this project measured.",
        ge=0,
        le=5,
    )
    rounds: int | None = setting(
        None,
        "How often the surface is checked, at most: again where it was corrected, until nothing more is asked for; null: 4 "
        "times for a "
        "surface from a file, once for the one that this project measured.",
        ge=1,
        le=12,
    )
    tolerance: float | None = setting(
        None,
        "Greatest error of a height that the survey allows; the report then tells which share of the surface is proved to keep it, "
        "breaks it, or stays undecided.",
        "m",
        gt=0,
    )
    closer: CloserLook = setting(CloserLook(), "How later rounds compare the orthoimages.")

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        yield self._surface(view)
        yield Job(
            stage=self.kind,
            item="pairs",
            function=choose_checked_pairs,
            reads={"pairs": PAIRS, "block": BLOCK, "surface": CHECKED_SURFACE},
            writes={"checked": CHECKED_PAIRS},
            params={
                "tile": view.project.tile,
                "count": self.pairs,
                "pixels_per_cell": self.pixels_per_cell,
                "per_place": self.pairs_per_place,
            },
        )
        # The grid of a file is known only after its header was read: planning continues when that job is done.
        surface = view.table(CHECKED_SURFACE)
        if isinstance(self.surface, SurfaceFile):
            passes = self._passes(view, surface)
            placed = yield from self._placed(view, passes, self.surface)
            yield from self._file(view, passes, self.surface, placed)
            yield from self._several(view, passes, placed)
        else:
            yield from self._own(view, surface.grid)
            passes = self._passes(view, surface)
            yield from self._one_pass(passes) if self._once else self._several(view, passes)
        yield from self._exports()

    @property
    def _once(self) -> bool:
        """Whether one pass over the surface is the whole check."""
        return self._rounds == 1 and self._levels == 0 and not isinstance(self.surface, SurfaceFile)

    @property
    def _rounds(self) -> int:
        if self.correction.kind == "norvelle":
            return self.correction.rounds
        return self.rounds or (_FILE_ROUNDS if isinstance(self.surface, SurfaceFile) else 1)

    @property
    def _levels(self) -> int:
        return self.levels if self.levels is not None else (_FILE_LEVELS if isinstance(self.surface, SurfaceFile) else 0)

    def _passes(self, view: ProjectView, surface: Surface) -> Passes:
        least_squares = self.matching.least_squares.model_copy(update={"window": self.closer.window})
        search = self.matching.search.model_copy(update={"window": self.closer.search_window})
        nearer = self.matching.model_copy(update={"least_squares": least_squares, "search": search})
        norvelle = self.correction.kind == "norvelle"
        return Passes(
            scene=CheckScene(view.table(BLOCK), view.table(PHOTOS), view.table(BLOCK).crs),
            surface=surface,
            pairs=view.table(CHECKED_PAIRS),
            tile=view.project.tile,
            how=Comparing(self.matching, self.correction, self.step, self.radius * self.step),
            closer=Comparing(nearer, self.correction, self.closer.step, self.radius * self.closer.step),
            apply="all" if norvelle else self.apply,
            significance=self.significance,
            count=self.pairs,
            per_place=self.pairs_per_place,
            everywhere=norvelle,
            measured=not isinstance(self.surface, SurfaceFile),
        )

    # --- the surface

    def _surface(self, view: ProjectView) -> Job:
        writes: dict[str, Raster | Table] = {"surface": CHECKED_SURFACE}
        if not isinstance(self.surface, SurfaceFile):
            return Job(stage=self.kind, item="surface", function=measured_surface, reads={"surface": SURFACE}, writes=writes)
        header = HeightHeader(self.surface.path, view.project.crs, self.surface.system)
        reads: Reads = {"extent": header, "block": BLOCK, "pairs": PAIRS}
        if view.has_stage("densification"):
            reads["surface"] = SURFACE
        return Job(stage=self.kind, item="surface", function=foreign_surface, reads=reads, writes=writes)

    def _own(self, view: ProjectView, grid: MapGrid) -> Iterator[RasterSpec | Job]:
        """The surface that the project measured."""
        size = view.project.tile
        yield map_raster(INPUT, grid, "float32", view.table(BLOCK).crs, size, nodata=float("nan"), unit="m")
        for tile in tiles_of(grid.shape, size):
            reads: Reads = {"heights": Raster(HEIGHT, tile.window)}
            writes = {"input": Raster(INPUT, tile.window)}
            yield Job(stage=self.kind, item="input", function=take_surface, reads=reads, writes=writes, row=tile.row, col=tile.col)

    def _placed(
        self, view: ProjectView, passes: Passes, source: SurfaceFile
    ) -> Generator[RasterSpec | Job, None, "_PlacedSurface"]:
        """Where a surface from a file lies to the photographs."""
        coarse = places(passes.surface.grid)
        given = HeightFile(source.path, view.project.crs, coarse, Window(0, 0, *coarse.shape), source.system)
        reads: Reads = {"heights": given, "block": BLOCK}
        if view.has_stage("orientation"):
            reads["points"] = GROUND_POINTS
        yield Job(
            stage=self.kind,
            item="place",
            function=place,
            reads=reads,
            writes={"placed": PLACED},
            params={"grid": coarse, "path": source.path},
        )
        rough, fine = (passes.lowest(level, _PLACING_CELLS) for level in _PLACING_LEVELS)
        for one in sorted({rough, fine, *range(1, passes.lowest(self._levels) + 1)}):
            yield level_pairs(passes, one)
        before, found, up, look = None, NO_SHIFT, view.table(PLACED).up, 0
        while look < _MOST_LOOKS and not (before and found.settled(before)):
            look += 1
            yield from placing(passes, view, source, look, fine if before else rough, up, found.certain)
            before, found = found, view.table(shift_after(look))
        if fine:
            # Windows on coarse orthoimages blur roofs: what they find is right to some tenths of a cell of theirs.
            look += 1
            yield level_pairs(passes, 0)
            yield from placing(passes, view, source, look, 0, up, found.certain)
            found = view.table(shift_after(look))
        moved = found.in_plan and source.shift == "remove"
        # To the millimetre: the surface that is given back must not show the digits of an estimate.
        return _PlacedSurface(shift_after(look), found, round(up - (found.up if moved else found.level), 3))

    def _file(self, view: ProjectView, passes: Passes, source: SurfaceFile, placed: "_PlacedSurface") -> Iterator[RasterSpec | Job]:
        """The surface from a file, in the height system of the photographs."""
        grid = passes.surface.grid
        taken = moved_grid(grid, placed.found) if source.shift == "remove" and placed.found.in_plan else grid
        yield passes.raster(INPUT)
        yield passes.raster(FILLED, "uint8")
        fill = source.holes == "fill" and view.has_stage("densification")
        for tile in tiles_of(grid.shape, view.project.tile):
            reads: Reads = {"heights": HeightFile(source.path, view.project.crs, taken, tile.window, source.system)}
            if fill:
                reads |= {"matched": Raster(HEIGHT, tile.window), "provenance": Raster(PROVENANCE, tile.window)}
            writes: dict[str, Raster | Table] = {"input": Raster(INPUT, tile.window), "filled": Raster(FILLED, tile.window)}
            params: dict[str, Any] = {"up": placed.up}
            yield Job(
                stage=self.kind,
                item="input",
                function=take_file,
                reads=reads,
                writes=writes,
                params=params,
                row=tile.row,
                col=tile.col,
            )

    # --- the passes

    def _one_pass(self, passes: Passes) -> Iterator[RasterSpec | Job]:
        one, rule = passes.main(INPUT), passes.rule()
        yield from one.jobs()
        yield from one.bends()
        yield from self._answer_rasters(passes)
        for tile in passes.tiles():
            windows, near = one.near(tile.window)
            reads: Reads = {"heights": Raster(INPUT, tile.window), "nodes": near, "bends": BENDS, **passes.codes(tile.window)}
            yield Job(
                stage=self.kind,
                item="answer",
                function=correct_tile,
                reads=reads,
                writes=_answer(tile, rule.block),
                params={"window": tile.window, "pairs": windows, "rule": rule, "shape": passes.surface.grid.shape},
                row=tile.row,
                col=tile.col,
                scratch=tile.window.width * 64 * 96 + tile.window.height * tile.window.width * 64,
            )
        yield self._report(passes, {}, {})

    def _several(self, view: ProjectView, passes: Passes, placed: "_PlacedSurface | None" = None) -> Iterator[RasterSpec | Job]:
        levels = passes.lowest(self._levels)
        if levels:
            if not isinstance(self.surface, SurfaceFile):
                yield from (level_pairs(passes, level) for level in range(1, levels + 1))
            yield from second_surface(passes, view, levels)
        yield from first_pass(passes, twice=levels > 0)
        number = 1
        while number < self._rounds and view.table(state_table(number)).judged:
            yield from later_pass(passes, number + 1, view.table(state_table(number)))
            number += 1
        yield from self._answer_rasters(passes)
        reads: Reads = {"rounds": tuple(state_table(k) for k in range(1, number + 1))}
        params: dict[str, Any] = {"last_round": number}
        back, own, keeps = 0.0, 0.0, True
        if isinstance(self.surface, SurfaceFile) and placed:
            keeps = self.surface.shift == "keep"
            back, own = -placed.up if keeps else 0.0, self.surface.sigma
            reads |= {"shift": placed.shift, "level": TREND}
            params |= {"raised": placed.up, "keeps": keeps}
        for tile in passes.tiles():
            writes = _answer(tile, block_size(passes.surface.grid.shape))
            yield answer_job(passes, tile, number, levels > 0, writes, Finish(passes.rule(), back, own), not keeps)
        yield self._report(passes, reads, params)

    def correction_nodes(self, pixels_per_cell: int) -> CorrectionNodes:
        """The grid of nodes on orthoimages of so many pixels along a cell, and how far they reach."""
        return correction_nodes(Comparing(self.matching, self.correction, self.step, self.radius * self.step), pixels_per_cell)

    # --- the answer

    def _answer_rasters(self, passes: Passes) -> Iterator[RasterSpec]:
        for name in (DH, PRECISION, TEST, DETECTABLE, CORRECTED):
            yield passes.raster(name) if name != TEST else passes.raster(name).model_copy(update={"unit": "sigma"})
        grid, size = passes.surface.grid, block_size(passes.surface.grid.shape)
        yield map_raster(CHECKED_CODE, grid, "uint8", passes.scene.crs, passes.tile, nodata=CheckCode.EMPTY)
        shape = tuple(-(-side // size) for side in grid.shape)
        yield RasterSpec(name=COARSE, shape=(*shape, 5), dtype="float32", chunk=passes.tile // size)

    def _report(self, passes: Passes, reads: Reads, params: dict[str, Any]) -> Job:
        grid, size = passes.surface.grid, block_size(passes.surface.grid.shape)
        shape = tuple(-(-side // size) for side in grid.shape)
        # A window around every node that the plane of a cell is fitted to: narrower errors lie in a part of that only.
        nodes = passes.main("").nodes
        wide = (nodes.window + 2 * nodes.radius) * grid.cell
        earlier = isinstance(self.surface, SurfaceFile) and self.surface.epoch == "earlier"
        words = CHANGES if earlier else ERRORS
        what = Blocks(
            grid=grid,
            size=size,
            significance=self.significance,
            crs=passes.scene.crs,
            tolerance=self.tolerance,
            wide=wide,
            words=words,
        )
        tiles = tuple(counts_table(tile, "counts") for tile in passes.tiles())
        coarse = Raster(COARSE, Window(0, 0, *shape))
        writes: dict[str, Raster | Table] = {"report": report_table(self.kind), "areas": AREA_MAP}
        return Job(
            stage=self.kind,
            item="report",
            function=report,
            reads={"tiles": tiles, "pairs": CHECKED_PAIRS, "coarse": coarse, "bends": BENDS, **reads},
            writes=writes,
            params={"blocks": what, **params},
            scratch=400 * shape[0] * shape[1],
        )

    def _exports(self) -> Iterator[Export]:
        bands = {"dh": DH, "height": CORRECTED, "sigma": PRECISION, "detectable": DETECTABLE, "test": TEST, "code": CHECKED_CODE}
        yield Export(self.kind, "product", "products/dsm_check.tif", "cog", bands)
        if isinstance(self.surface, SurfaceFile):
            yield Export(self.kind, "corrected", "products/dsm_corrected.tif", "cog", {"height": CORRECTED})
        yield Export(self.kind, "areas", "products/dsm_check_areas.geojson", "json", tables=(AREA_MAP,))


def _answer(tile: Tile, size: int) -> dict[str, Raster | Table]:
    """What a tile of the answer writes; size: cells along a coarse block."""
    names = {"dh": DH, "precision": PRECISION, "test": TEST, "detectable": DETECTABLE, "height": CORRECTED, "code": CHECKED_CODE}
    return {
        **{name: Raster(raster, tile.window) for name, raster in names.items()},
        "coarse": Raster(COARSE, coarser(tile.window, size)),
        "counts": counts_table(tile, "counts"),
    }


class _PlacedSurface(NamedTuple):
    """Where a surface from a file lies: its shift after it was brought to the tie points, and what is added to its heights, m."""

    shift: Table[SurfaceShift]
    found: SurfaceShift
    up: float
