"""The jobs that compare the terrain with the true ground."""

from collections.abc import Iterator

from orthomill.schemas.bare_ground import TERRAIN, TERRAIN_CODE, TERRAIN_PRECISION
from orthomill.schemas.job import Job, Raster, Reading, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, tiles_of
from orthomill.schemas.surface import PROVENANCE
from orthomill.schemas.truth import TRUTH_GROUND, TRUTH_MATERIAL
from orthomill.tasks.evaluation.classes import HALO
from orthomill.tasks.evaluation.grids import placement, readable
from orthomill.tasks.evaluation.ground_accuracy import GroundSummary, GroundSums, ground_against_truth, summarise_ground

GROUND_SUMMARY = Table("evaluation/terrain.json", GroundSummary)


def ground_jobs(grid: MapGrid, truth: MapGrid, tile: int) -> Iterator[Job]:
    """A terrain on `grid` in tiles of `tile` cells, the truth on its own grid."""
    results = []
    own = {"height": TERRAIN, "precision": TERRAIN_PRECISION, "code": TERRAIN_CODE, "provenance": PROVENANCE}
    for t in tiles_of(grid.shape, tile):
        place = placement(grid, t.window.grown(HALO), truth)
        reads: dict[str, Reading] = {key: Raster(name, t.window) for key, name in own.items()}
        reads |= {key: Raster(name, readable(place)) for key, name in (("ground", TRUTH_GROUND), ("material", TRUTH_MATERIAL))}
        results.append(Table(f"evaluation/terrain/{t.row}-{t.col}.parquet", GroundSums))
        yield Job(
            stage="evaluation",
            item="terrain",
            function=ground_against_truth,
            reads=reads,
            writes={"sums": results[-1]},
            params={"place": place, "core": t.window},
            row=t.row,
            col=t.col,
            scratch=array_bytes(120, place.window),
        )
    yield Job(
        stage="evaluation",
        item="terrain_summary",
        function=summarise_ground,
        reads={"parts": tuple(results)},
        writes={"summary": GROUND_SUMMARY},
    )
