"""The plan of a check in several passes: coarse levels, the full resolution, and again where something was corrected.

Every pass leaves a raster of heights for the next one. A pass over the whole surface uses the tiles of the project; a later one,
which looks at a few places, small ones.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import HeightFile, Job, Raster, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.surface import PROVENANCE, Surface
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.correction_map import TOGETHER
from orthomill.tasks.dsm_check.coverage import CHECKED_SURFACE, CheckedPairs
from orthomill.tasks.dsm_check.joint_correction import BENDS
from orthomill.tasks.dsm_check.rounds.carried import carry
from orthomill.tasks.dsm_check.rounds.coarse_levels import (
    FINER_HALO,
    PAIRED,
    START_HALO,
    START_SIDE,
    Far,
    choose_level_pairs,
    finer_surface,
    finest_surface,
    judge_coarse,
    level_surface,
    raised,
    start_surface,
)
from orthomill.tasks.dsm_check.rounds.finish import Finish, finish
from orthomill.tasks.dsm_check.rounds.round_plan import (
    KIND,
    CheckRound,
    CheckScene,
    Comparing,
    Reads,
    coarser,
    correction_nodes,
    node_halo,
)
from orthomill.tasks.dsm_check.rounds.round_state import (
    LookAgain,
    MergeRule,
    RoundCounts,
    RoundState,
    judge,
    judge_again,
    least_change,
    look_again,
    merge,
    precise_enough,
    state_table,
)
from orthomill.tasks.dsm_check.statistics import TileCounts
from orthomill.tasks.dsm_check.surfaces.checked_surface import SurfaceFile
from orthomill.tasks.dsm_check.surfaces.surface_shift import (
    TREND,
    SurfaceShift,
    further_shift,
    moved_grid,
    shift_after,
    surface_trend,
)
from orthomill.tasks.dsm_check.tile import CorrectionRule, blocks_of_nodes

NAN = float("nan")
_FEWEST_CELLS = 48
"""along the shorter side of the coarsest level: fewer hold no windows to be compared"""
_SMALL = (256, 128, 64)
"""sides of the tiles of a later pass, cells; the first that divides the tiles of the project"""

Plan = Iterator[RasterSpec | Job]


@dataclass(frozen=True)
class Passes:
    """What all passes share."""

    scene: CheckScene
    surface: Surface
    pairs: CheckedPairs
    tile: int
    how: Comparing
    closer: Comparing
    """how later passes compare"""
    apply: Literal["all", "significant", "none"]
    significance: float
    count: int | None
    per_place: int
    everywhere: bool
    """whether later passes judge every cell again"""
    measured: bool
    """whether the project measured the surface, and knows where its heights come from"""

    def rule(self) -> CorrectionRule:
        """How corrections at full resolution become a surface."""
        grid, main = self.surface.grid, self.main("")
        return CorrectionRule(self.apply, self.significance, main.nodes, block_size(grid.shape), self.pairs.pixel_height, grid.cell)

    def main(self, heights: str) -> CheckRound:
        """The pass at full resolution."""
        return CheckRound(KIND, self.scene, self.surface, self.pairs, heights, self.tile, self.how)

    def tiles(self) -> Iterator[Tile]:
        return tiles_of(self.surface.grid.shape, self.tile)

    def codes(self, window: Window) -> Reads:
        """Where the heights under test come from; nothing is known of those of a file."""
        return {"provenance": Raster(PROVENANCE, window)} if self.measured else {}

    def raster(self, name: str, dtype: str = "float32") -> RasterSpec:
        """A raster on the grid of the surface."""
        nodata = NAN if dtype == "float32" else 0
        return map_raster(name, self.surface.grid, dtype, self.scene.crs, self.tile, nodata=nodata, unit="m" if nodata else "")

    # --- coarse levels

    def lowest(self, levels: int, fewest: int = _FEWEST_CELLS) -> int:
        """How often the orthoimages can be halved: `levels` times at most, and to `fewest` cells along the shorter side."""
        side, level = min(self.surface.grid.shape), 0
        while level < levels and side >> (level + 1) >= fewest:
            level += 1
        return level

    def pairs_of(self, level: int) -> Table[CheckedPairs]:
        return Table(f"dsm_check/pairs/{level}.json", CheckedPairs)

    def level_pairs(self, level: int) -> Job:
        """The pairs of a level, on its grid."""
        params = {"level": level, "tile": self.tile, "count": self.count, "per_place": self.per_place}
        reads: Reads = {"pairs": PAIRS, "block": BLOCK, "surface": CHECKED_SURFACE}
        return Job(
            stage=KIND,
            item=f"pairs-{level}",
            function=choose_level_pairs,
            reads=reads,
            writes={"checked": self.pairs_of(level)},
            params=params,
        )

    def placing(self, view: ProjectView, source: SurfaceFile, look: int, level: int, up: float, before: SurfaceShift) -> Plan:
        """The shift of a surface from a file, raised by `up` m, from one pass at a coarse level over the surface moved back by
        what is known of it."""
        prefix = f"dsm_check/placing-{look}"
        coarse = level_surface(self.surface, level)
        there = moved_grid(coarse.grid, before)
        yield map_raster(f"{prefix}/height", coarse.grid, "float32", self.scene.crs, self.tile, nodata=NAN, unit="m")
        for tile in tiles_of(coarse.grid.shape, self.tile):
            given = HeightFile(source.path, self.scene.crs, there, tile.window, source.system)
            out: dict[str, Raster | Table] = {"height": Raster(f"{prefix}/height", tile.window)}
            how = {"up": up - before.up}
            yield Job(
                stage=KIND,
                item=f"placing-{look}-height",
                function=raised,
                reads={"heights": given},
                writes=out,
                params=how,
                row=tile.row,
                col=tile.col,
                scratch=_scratch(tile),
            )
        yield from self._coarse(view, prefix, level, f"{prefix}/height")
        rows, cols = (-(-side // PAIRED) for side in coarse.grid.shape)
        whole = Raster(f"{prefix}/coarse", Window(0, 0, rows, cols))
        params = {"side": PAIRED << level, "before": before}
        yield Job(
            stage=KIND,
            item=f"placing-{look}-shift",
            function=further_shift,
            reads={"coarse": whole},
            writes={"shift": shift_after(look)},
            params=params,
        )

    def second_surface(self, view: ProjectView, top: int) -> Plan:
        """The second surface, from level `top` to the first; the result is `SECOND`."""
        yield from self._start(top)
        for level in range(top, 0, -1):
            yield from self._coarse(view, f"dsm_check/level-{level}", level, f"dsm_check/level-{level}/height")
            yield from self._finer(level) if level > 1 else self._finest(view)

    def _start(self, level: int) -> Plan:
        coarse, side = level_surface(self.surface, level), 2**level
        yield self._level_heights(level)
        for tile in tiles_of(coarse.grid.shape, self.tile):
            given = tile.window.grown(START_HALO).clipped(coarse.grid.shape)
            fine = Raster("dsm_check/input", given.scaled(side).clipped(self.surface.grid.shape))
            out: dict[str, Raster | Table] = {"height": Raster(f"dsm_check/level-{level}/height", tile.window)}
            params = {"window": tile.window, "given": given, "level": level}
            scratch = 40 * given.height * given.width * (side**2 + START_SIDE**2)
            yield Job(
                stage=KIND,
                item=f"level-{level}-start",
                function=start_surface,
                reads={"heights": fine},
                writes=out,
                params=params,
                row=tile.row,
                col=tile.col,
                scratch=scratch,
            )

    def _finer(self, level: int) -> Plan:
        finer = level_surface(self.surface, level - 1)
        yield self._level_heights(level - 1)
        for tile in tiles_of(finer.grid.shape, self.tile):
            given, reads = self._from_level(level, tile.window)
            out: dict[str, Raster | Table] = {"heights": Raster(f"dsm_check/level-{level - 1}/height", tile.window)}
            params = {"window": tile.window, "given": given}
            what = f"level-{level}-finer"
            yield Job(
                stage=KIND,
                item=what,
                function=finer_surface,
                reads=reads,
                writes=out,
                params=params,
                row=tile.row,
                col=tile.col,
                scratch=_scratch(tile),
            )

    def _finest(self, view: ProjectView) -> Plan:
        pixel_height = view.table(self.pairs_of(1)).pixel_height
        rule = Far.of(self.significance, self.how.matching.search.reach, pixel_height)
        yield self.raster(SECOND)
        yield self.raster(FAR, "uint8")
        for tile in self.tiles():
            given, reads = self._from_level(1, tile.window)
            reads |= {"sigma": Raster("dsm_check/level-1/precision", given), "under_test": Raster("dsm_check/input", tile.window)}
            out: dict[str, Raster | Table] = {"second": Raster(SECOND, tile.window), "far": Raster(FAR, tile.window)}
            params = {"window": tile.window, "given": given, "rule": rule}
            yield Job(
                stage=KIND,
                item="level-1-finest",
                function=finest_surface,
                reads=reads,
                writes=out,
                params=params,
                row=tile.row,
                col=tile.col,
                scratch=_scratch(tile),
            )

    def _level_heights(self, level: int) -> RasterSpec:
        grid = level_surface(self.surface, level).grid
        return map_raster(f"dsm_check/level-{level}/height", grid, "float32", self.scene.crs, self.tile, nodata=NAN, unit="m")

    def _from_level(self, level: int, window: Window) -> tuple[Window, Reads]:
        """The cells of a level that a finer window needs, and what is known there."""
        given = window.reduced(2).grown(FINER_HALO).clipped(level_surface(self.surface, level).grid.shape)
        return given, {
            "heights": Raster(f"dsm_check/level-{level}/height", given),
            "dh": Raster(f"dsm_check/level-{level}/dh", given),
        }

    def _coarse(self, view: ProjectView, prefix: str, level: int, heights: str) -> Plan:
        """One pass at a coarse level: dh, precision and coarse below `prefix`."""
        coarse, pairs = level_surface(self.surface, level), view.table(self.pairs_of(level))
        one = CheckRound(prefix, self.scene, coarse, pairs, heights, self.tile, self.how, coarse=True)
        yield from one.jobs()
        for name in ("dh", "precision"):
            yield map_raster(f"{prefix}/{name}", coarse.grid, "float32", self.scene.crs, self.tile, nodata=NAN, unit="m")
        rows, cols = (-(-side // PAIRED) for side in coarse.grid.shape)
        yield RasterSpec(name=f"{prefix}/coarse", shape=(rows, cols, 5), dtype="float32", chunk=self.tile // PAIRED)
        for tile in tiles_of(coarse.grid.shape, self.tile):
            windows, near = one.near(tile.window)
            reads: Reads = {"heights": Raster(heights, tile.window), "nodes": near}
            writes: dict[str, Raster | Table] = {n: Raster(f"{prefix}/{n}", tile.window) for n in ("dh", "precision")}
            writes["coarse"] = Raster(f"{prefix}/coarse", coarser(tile.window, PAIRED))
            params = {"window": tile.window, "pairs": windows, "grid": one.nodes, "cell": coarse.grid.cell}
            yield Job(
                stage=KIND,
                item=f"{one.item}judge",
                function=judge_coarse,
                reads=reads,
                writes=writes,
                params=params,
                row=tile.row,
                col=tile.col,
                scratch=_scratch(tile),
            )

    # --- full resolution

    def first(self, twice: bool) -> Plan:
        """The first pass over the whole surface, and over the second one."""
        one, other, rule = self.main("dsm_check/input"), self._second_pass(), self.rule()
        yield from one.jobs()
        if twice:
            yield from other.jobs()
        yield from one.bends()
        if not self.measured:
            yield from self._trend(one)
        yield from self._state_rasters(1, disputed=True)
        for tile in self.tiles():
            windows, near = one.near(tile.window)
            params: dict[str, Any] = {"window": tile.window, "pairs": windows, "rule": rule}
            reads: Reads = {"heights": Raster("dsm_check/input", tile.window), "nodes": near, **self.codes(tile.window)}
            reads |= {"bends": BENDS, **self._of_trend}
            if twice:
                wide = tile.window.grown(2).clipped(self.surface.grid.shape)
                reads |= {"heights": Raster("dsm_check/input", wide), "second": Raster(SECOND, wide)}
                reads["second_nodes"] = other.near(tile.window)[1]
                params["wide"] = wide
            writes: dict[str, Raster | Table] = {
                **self._state(1, tile),
                "disputed": Raster(of_round(1, "disputed"), tile.window),
                "counts": counts_table(tile),
            }
            yield Job(
                stage=KIND,
                item="judge",
                function=judge,
                reads=reads,
                writes=writes,
                params=params,
                row=tile.row,
                col=tile.col,
                scratch=_scratch(tile),
            )
        yield self._look_again(1)

    def _trend(self, one: CheckRound) -> Plan:
        """What the first pass asks for all over the surface."""
        grid, (size, shape) = self.surface.grid, self._blocks()
        yield RasterSpec(name=_FIRST_BLOCKS, shape=(*shape, 3), dtype="float32", chunk=self.tile // size)
        for tile in self.tiles():
            windows, near = one.near(tile.window)
            reads: Reads = {"heights": Raster("dsm_check/input", tile.window), "nodes": near, "bends": BENDS}
            out: dict[str, Raster | Table] = {"coarse": Raster(_FIRST_BLOCKS, coarser(tile.window, size))}
            params = {"window": tile.window, "pairs": windows, "grid": one.nodes, "size": size}
            yield Job(
                stage=KIND,
                item="trend-blocks",
                function=blocks_of_nodes,
                reads=reads,
                writes=out,
                params=params,
                row=tile.row,
                col=tile.col,
                scratch=_scratch(tile),
            )
        whole = Raster(_FIRST_BLOCKS, Window(0, 0, *shape))
        params = {"grid": grid, "size": size, "pixel_height": self.pairs.pixel_height}
        yield Job(stage=KIND, item="trend", function=surface_trend, reads={"coarse": whole}, writes={"trend": TREND}, params=params)

    @property
    def _of_trend(self) -> Reads:
        """The trend of a surface from a file."""
        return {} if self.measured else {"trend": TREND}

    def _second_pass(self) -> CheckRound:
        return CheckRound("dsm_check/second", self.scene, self.surface, self.pairs, SECOND, self.tile, self.how)

    def later(self, number: int, state: RoundState) -> Plan:
        """A later pass over the tiles that `state` names."""
        small = self.tile if self.everywhere else self._small()
        before = number - 1
        prefix = f"dsm_check/rounds/{number}"
        yield from self._carried(before)
        again = CheckRound(
            prefix, self.scene, self.surface, self.pairs, of_round(before, "carried"), small, self._how(), again=state
        )
        yield from again.jobs()
        for name in ("dh", "sigma"):
            yield replace_chunk(self.raster(f"{prefix}/{name}"), small)
        block, judged = block_size(self.surface.grid.shape), set(state.judged)
        for tile in tiles_of(self.surface.grid.shape, small):
            if (tile.row, tile.col) in judged:
                windows, near = again.near(tile.window)
                active = Raster(of_round(before, "active"), coarser(tile.window, block))
                out: dict[str, Raster | Table] = {
                    "dh": Raster(f"{prefix}/dh", tile.window),
                    "precision": Raster(f"{prefix}/sigma", tile.window),
                }
                params = {"window": tile.window, "pairs": windows, "grid": again.nodes, "block": block}
                what = f"{again.item}judge"
                yield Job(
                    stage=KIND,
                    item=what,
                    function=judge_again,
                    reads={"active": active, "nodes": near, "bends": BENDS, **self._of_trend},
                    writes=out,
                    params=params,
                    row=tile.row,
                    col=tile.col,
                    scratch=_scratch(tile),
                )
        yield from self._state_rasters(number)
        for tile in self.tiles():
            yield self._merge(number, tile, small, judged)
        yield self._look_again(number)

    def _carried(self, number: int) -> Plan:
        """The heights with which the pass after `number` begins."""
        name = of_round(number, "carried")
        yield self.raster(name)
        for tile in self.tiles():
            wide = tile.window.grown(self._around).clipped(self.surface.grid.shape)
            reads: Reads = {
                "heights": Raster(of_round(number, "height"), wide),
                "given": Raster("dsm_check/input", wide),
                "residual": Raster(of_round(number, "residual"), wide),
            }
            params = {"window": tile.window, "wide": wide, "reach": self._around}
            out: dict[str, Raster | Table] = {"heights": Raster(name, tile.window)}
            yield Job(
                stage=KIND,
                item=f"rounds/{number}-carry",
                function=carry,
                reads=reads,
                writes=out,
                params=params,
                row=tile.row,
                col=tile.col,
                scratch=_scratch(tile),
            )

    @property
    def _around(self) -> int:
        """Cells around a change that have a node with a window on it."""
        nodes = correction_nodes(self._how(), self.pairs.pixels_per_cell)
        return int(nodes.window / 2 + nodes.radius) + 2

    def _merge(self, number: int, tile: Tile, small: int, judged: set[tuple[int, int]]) -> Job:
        inside = [t for t in tiles_of(self.surface.grid.shape, small) if (t.row, t.col) in judged and _holds(tile, t)]
        parts = tuple(t.window for t in inside)
        prefix, before = f"dsm_check/rounds/{number}", number - 1
        reads: Reads = {
            **{
                argument: Raster(of_round(before, name), tile.window)
                for argument, name in (("heights", "carried"), *((n, n) for n in ("residual", "precision", "last")))
            },
            **self.codes(tile.window),
        }
        if parts:
            reads["dh"] = tuple(Raster(f"{prefix}/dh", part) for part in parts)
            reads["sigma"] = tuple(Raster(f"{prefix}/sigma", part) for part in parts)
        pixel, size = self.pairs.pixel_height, block_size(self.surface.grid.shape)
        rule = MergeRule(self.apply, self.significance, size, number, least_change(pixel), precise_enough(pixel))
        params = {"window": tile.window, "parts": parts, "rule": rule}
        return Job(
            stage=KIND,
            item=f"rounds/{number}-merge",
            function=merge,
            reads=reads,
            writes=self._state(number, tile),
            params=params,
            row=tile.row,
            col=tile.col,
            scratch=_scratch(tile),
        )

    def _how(self) -> Comparing:
        return self.how if self.everywhere else self.closer

    def _small(self) -> int:
        return next(side for side in _SMALL if self.tile % side == 0)

    def _state_rasters(self, number: int, disputed: bool = False) -> Iterator[RasterSpec]:
        for name in ("height", "residual", "precision"):
            yield self.raster(of_round(number, name))
        yield self.raster(of_round(number, "last"), "uint8")
        if disputed:
            yield self.raster(of_round(number, "disputed"), "uint8")
        size, shape = self._blocks()
        yield RasterSpec(name=of_round(number, "asks"), shape=shape, dtype="uint16", chunk=self.tile // size)
        yield RasterSpec(name=of_round(number, "active"), shape=shape, dtype="uint8", chunk=max(shape))

    def _blocks(self) -> tuple[int, tuple[int, int]]:
        """Side of a block in cells, and (rows, cols) of blocks."""
        size = block_size(self.surface.grid.shape)
        rows, cols = self.surface.grid.shape
        return size, (-(-rows // size), -(-cols // size))

    def _state(self, number: int, tile: Tile) -> dict[str, Raster | Table]:
        names = ("height", "residual", "precision", "last")
        return {
            **{name: Raster(of_round(number, name), tile.window) for name in names},
            "asks": Raster(of_round(number, "asks"), coarser(tile.window, self._blocks()[0])),
            "changes": _changes(number, tile),
        }

    def _look_again(self, number: int) -> Job:
        size, shape = self._blocks()
        small = self.tile if self.everywhere else self._small()
        how = self._how()
        factor = self.pairs.pixels_per_cell
        again = CheckRound(KIND, self.scene, self.surface, self.pairs, "", small, how)
        where = LookAgain(
            size,
            small,
            self.surface.grid.shape,
            self._around,
            again.nodes.halo * how.step,
            node_halo(how, factor) + 1,
            self.everywhere,
        )
        reads: Reads = {
            "asks": Raster(of_round(number, "asks"), Window(0, 0, *shape)),
            "counts": tuple(_changes(number, tile) for tile in self.tiles()),
        }
        writes: dict[str, Raster | Table] = {
            "active": Raster(of_round(number, "active"), Window(0, 0, *shape)),
            "state": state_table(number),
        }
        return Job(
            stage=KIND,
            item=f"rounds/{number}-state",
            function=look_again,
            reads=reads,
            writes=writes,
            params={"where": where},
            scratch=64 * shape[0] * shape[1],
        )

    # --- the end

    def finish(
        self, tile: Tile, number: int, twice: bool, writes: dict[str, Raster | Table], how: Finish, level: bool = False
    ) -> Job:
        """The answer in a tile after pass `number`; twice: whether there is a second surface; level: whether the trend is taken out
        of the corrected surface."""
        # Whether a cell stands alone is seen by the cells around the tile.
        wide = tile.window.grown(TOGETHER - 1).clipped(self.surface.grid.shape)
        reads: Reads = {
            "given": Raster("dsm_check/input", wide),
            **{name: Raster(of_round(number, name), wide) for name in ("height", "residual", "precision")},
            "disputed": Raster(of_round(1, "disputed"), tile.window),
            "counts": counts_table(tile),
            **self.codes(tile.window),
        }
        if twice:
            reads["far"] = Raster(FAR, tile.window)
        if level:
            reads |= self._of_trend
        if not self.measured:
            reads["filled"] = Raster(FILLED, tile.window)
        params = {"window": tile.window, "wide": wide, "how": how}
        return Job(
            stage=KIND,
            item="answer",
            function=finish,
            reads=reads,
            writes=writes,
            params=params,
            row=tile.row,
            col=tile.col,
            scratch=_scratch(tile),
        )


FILLED = "dsm_check/filled"
"""uint8, 1 where the photographs filled a hole of a surface from a file"""


_FIRST_BLOCKS = "dsm_check/first_blocks"
"""float32 (rows, cols, 3): `areas.blocks` of the first pass"""
SECOND, FAR = "dsm_check/second_surface", "dsm_check/far"
"""float32 m: the second surface; uint8, 1 where the given one is far from it"""


def of_round(number: int, name: str) -> str:
    """A raster after pass `number` at full resolution."""
    return f"dsm_check/rounds/{number}/{name}"


def counts_table(tile: Tile, name: str = "judged") -> Table[TileCounts]:
    """Counts of a tile after the first pass, or of the answer."""
    return Table(f"dsm_check/{name}/{tile.row}-{tile.col}.json", TileCounts)


def replace_chunk(spec: RasterSpec, chunk: int) -> RasterSpec:
    """The raster in other chunks."""
    return spec.model_copy(update={"chunk": chunk})


def _changes(number: int, tile: Tile) -> Table[RoundCounts]:
    return Table(f"dsm_check/rounds/{number}/{tile.row}-{tile.col}.json", RoundCounts)


def _holds(tile: Tile, other: Tile) -> bool:
    window, part = tile.window, other.window
    inside_rows = window.row <= part.row < window.row + window.height
    return inside_rows and window.col <= part.col < window.col + window.width


def _scratch(tile: Tile) -> int:
    return tile.window.width * 64 * 96 + tile.window.height * tile.window.width * 64
