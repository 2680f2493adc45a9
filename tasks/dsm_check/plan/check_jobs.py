"""The jobs of the check of a surface without reference data, tile by tile, in one pass or in several.

First the pairs that check it are selected. Every pair and tile gets two orthoimages made with the surface under test, then the
nodes at which they are compared. A tile of the result needs the nodes around it of every pair that shows it; the report is made of
the coarse blocks and counts of all tiles.

A surface from a file goes farther: it is placed by the tie points, coarse orthoimages find its shift and make a second surface,
beside which its large and narrow errors show, and the places that were corrected are checked again until nothing is asked for any
more. The engine needs no loop for that: a pass asks for the table of the one before.
"""

from collections.abc import Iterator
from typing import Any

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import Export, Job, Raster
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.surface import CHECKED_SURFACE, CORRECTED, GIVEN_CODE, GIVEN_HEIGHT, GIVEN_PRECISION, Surface
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.coverage import CHECKED_PAIRS, choose_checked_pairs
from orthomill.tasks.dsm_check.joint_correction import BENDS
from orthomill.tasks.dsm_check.plan.answer import answer_job
from orthomill.tasks.dsm_check.plan.check_answer import answer_rasters, answer_writes, exports, report_job
from orthomill.tasks.dsm_check.plan.coarse_passes import level_pairs, second_surface
from orthomill.tasks.dsm_check.plan.first_pass import first_pass
from orthomill.tasks.dsm_check.plan.later_passes import later_pass
from orthomill.tasks.dsm_check.plan.passes import Passes
from orthomill.tasks.dsm_check.plan.round_plan import CheckScene, Comparing, Reads
from orthomill.tasks.dsm_check.plan.surface_under_test import (
    INPUT,
    PlacedSurface,
    own_surface,
    placed_surface,
    surface_from_file,
    surface_job,
)
from orthomill.tasks.dsm_check.rounds.finish import Finish
from orthomill.tasks.dsm_check.rounds.round_state import state_table
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.dsm_check.surfaces.checked_surface import SurfaceFile
from orthomill.tasks.dsm_check.surfaces.surface_shift import TREND
from orthomill.tasks.dsm_check.surfaces.taken_surface import painted_surface
from orthomill.tasks.dsm_check.tile import correct_tile


def check_jobs(asked: DsmCheckStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """The surface under test, the pairs that check it, the passes over it, and what is taken away."""
    yield surface_job(asked, view)
    yield Job(
        stage=asked.kind,
        item="pairs",
        function=choose_checked_pairs,
        reads={"pairs": PAIRS, "block": BLOCK, "surface": CHECKED_SURFACE},
        writes={"checked": CHECKED_PAIRS},
        params={
            "tile": view.project.tile,
            "count": asked.pairs,
            "pixels_per_cell": asked.pixels_per_cell,
            "per_place": asked.pairs_per_place,
        },
    )
    # The grid of a file is known only after its header was read: planning continues when that job is done.
    surface = view.table(CHECKED_SURFACE)
    if isinstance(asked.surface, SurfaceFile):
        passes = _passes(asked, view, surface)
        placed = yield from placed_surface(asked, view, passes, asked.surface)
        yield from surface_from_file(asked, view, passes, asked.surface, placed)
        yield from _several(asked, view, passes, placed)
    else:
        yield from own_surface(asked, view, surface.grid)
        passes = _passes(asked, view, surface)
        yield from _one_pass(asked, passes) if asked.once else _several(asked, view, passes)
    yield from exports(asked)


def _passes(asked: DsmCheckStage, view: ProjectView, surface: Surface) -> Passes:
    least_squares = asked.matching.least_squares.model_copy(update={"window": asked.closer.window})
    search = asked.matching.search.model_copy(update={"window": asked.closer.search_window})
    nearer = asked.matching.model_copy(update={"least_squares": least_squares, "search": search})
    norvelle = asked.correction.kind == "norvelle"
    return Passes(
        scene=CheckScene(view.table(BLOCK), view.table(PHOTOS), view.table(BLOCK).crs),
        surface=surface,
        pairs=view.table(CHECKED_PAIRS),
        tile=view.project.tile,
        how=Comparing(asked.matching, asked.correction, asked.step, asked.radius * asked.step),
        closer=Comparing(nearer, asked.correction, asked.closer.step, asked.radius * asked.closer.step),
        apply="all" if norvelle else asked.apply,
        significance=asked.significance,
        count=asked.pairs,
        per_place=asked.pairs_per_place,
        everywhere=norvelle,
        measured=not isinstance(asked.surface, SurfaceFile),
    )


def _one_pass(asked: DsmCheckStage, passes: Passes) -> Iterator[RasterSpec | Job]:
    one, rule = passes.main(INPUT), passes.rule()
    yield from one.jobs()
    yield from one.bends()
    yield from answer_rasters(asked, passes)
    for tile in passes.tiles():
        windows, near = one.near(tile.window)
        reads: Reads = {"heights": Raster(INPUT, tile.window), "nodes": near, "bends": BENDS, **passes.codes(tile.window)}
        yield Job(
            stage=asked.kind,
            item="answer",
            function=correct_tile,
            reads=reads,
            writes=answer_writes(tile, rule.block),
            params={"window": tile.window, "pairs": windows, "rule": rule, "shape": passes.surface.grid.shape},
            row=tile.row,
            col=tile.col,
            scratch=array_bytes(64, 96, tile.window.width) + array_bytes(64, tile.window),
        )
    yield report_job(asked, passes, {}, {})


def _several(
    asked: DsmCheckStage, view: ProjectView, passes: Passes, placed: PlacedSurface | None = None
) -> Iterator[RasterSpec | Job]:
    levels = passes.lowest(asked.most_levels)
    if levels:
        if not isinstance(asked.surface, SurfaceFile):
            yield from (level_pairs(passes, level) for level in range(1, levels + 1))
        yield from second_surface(passes, view, levels)
    yield from first_pass(passes, twice=levels > 0)
    number = 1
    while number < asked.most_rounds and view.table(state_table(number)).judged:
        yield from later_pass(passes, number + 1, view.table(state_table(number)))
        number += 1
    yield from answer_rasters(asked, passes)
    reads: Reads = {"rounds": tuple(state_table(k) for k in range(1, number + 1))}
    params: dict[str, Any] = {"last_round": number}
    back, own, keeps = 0.0, 0.0, True
    if isinstance(asked.surface, SurfaceFile) and placed:
        keeps = asked.surface.shift == "keep"
        back, own = -placed.up if keeps else 0.0, asked.surface.sigma
        reads |= {"shift": placed.shift, "level": TREND}
        params |= {"raised": placed.up, "keeps": keeps}
    for tile in passes.tiles():
        writes = answer_writes(tile, block_size(passes.surface.grid.shape))
        yield answer_job(passes, tile, number, levels > 0, writes, Finish(passes.rule(), back, own), not keeps)
    yield report_job(asked, passes, reads, params)
    if isinstance(asked.surface, SurfaceFile) and view.has_stage("texture") and not view.has_stage("densification"):
        yield from _painted(asked, passes, back, own)


def _painted(asked: DsmCheckStage, passes: Passes, back: float, own: float) -> Iterator[RasterSpec | Job]:
    """The corrected surface as the orthoimage needs it: in the height system of the photographs, with codes and standard errors."""
    names = {"height": GIVEN_HEIGHT, "precision": GIVEN_PRECISION, "code": GIVEN_CODE}
    for name in names.values():
        yield passes.raster(name, "uint8") if name == GIVEN_CODE else passes.raster(name)
    for tile in passes.tiles():
        yield Job(
            stage=asked.kind,
            item="painted",
            function=painted_surface,
            reads={"corrected": Raster(CORRECTED, tile.window)},
            writes={key: Raster(name, tile.window) for key, name in names.items()},
            params={"back": back, "sigma": own},
            row=tile.row,
            col=tile.col,
        )
