"""The jobs that compare heights with points of known height, from a table or a point cloud."""

from collections.abc import Iterator
from pathlib import PurePath

from orthomill.schemas.job import Job, MeshFile, Raster, Reading, Table, TextFile
from orthomill.schemas.raster import MapGrid, tiles_of
from orthomill.schemas.surface import PRECISION, PROVENANCE
from orthomill.tasks.evaluation.point_accuracy import (
    HALO,
    PointDifferences,
    PointsSummary,
    PointTile,
    points_in_tile,
    summarise_points,
)
from orthomill.tasks.evaluation.reference_points import ReferencePoints, points_of_cloud, points_of_table

POINTS = Table("evaluation/reference_points.parquet", ReferencePoints)
POINTS_SUMMARY = Table("evaluation/points.json", PointsSummary)
_CLOUDS = (".las", ".laz", ".ply")


def point_jobs(path: str, sigma: float, source: str, grid: MapGrid, tile: int) -> Iterator[Job]:
    """The heights `source` on `grid`, in tiles of `tile` cells, at the points of a file of the project."""
    yield _reading(path, sigma)
    results = []
    for t in tiles_of(grid.shape, tile):
        window = t.window.grown(HALO).clipped(grid.shape)
        results.append(Table(f"evaluation/points/{t.row}-{t.col}.parquet", PointDifferences))
        reads: dict[str, Reading] = {"points": POINTS}
        for key, name in (("height", source), ("precision", PRECISION), ("provenance", PROVENANCE)):
            reads[key] = Raster(name, window)
        yield Job(
            stage="evaluation",
            item="points",
            function=points_in_tile,
            reads=reads,
            writes={"differences": results[-1]},
            params={"where": PointTile(grid, t.window, window)},
            row=t.row,
            col=t.col,
        )
    yield Job(
        stage="evaluation",
        item="points_summary",
        function=summarise_points,
        reads={"parts": tuple(results), "points": POINTS},
        writes={"summary": POINTS_SUMMARY},
        params={"grid": grid},
    )


def _reading(path: str, sigma: float) -> Job:
    if PurePath(path).suffix.lower() in _CLOUDS:
        return Job(
            stage="evaluation",
            item="reference_points",
            function=points_of_cloud,
            reads={"cloud": MeshFile(path)},
            writes={"points": POINTS},
            params={"sigma": sigma},
        )
    return Job(
        stage="evaluation",
        item="reference_points",
        function=points_of_table,
        reads={"text": TextFile(path)},
        writes={"points": POINTS},
        params={"path": path, "sigma": sigma},
    )
