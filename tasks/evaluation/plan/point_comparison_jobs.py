"""The jobs that compare heights with points of known height, from a table or a point cloud."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import PurePath

from orthomill.schemas.job import CloudFile, Job, MeshFile, Raster, Reading, Table, TextFile
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
from orthomill.tasks.evaluation.reference_points import ReferencePoints, points_of_cloud, points_of_mesh, points_of_table

POINTS = Table("evaluation/reference_points.parquet", ReferencePoints)
POINTS_SUMMARY = Table("evaluation/points.json", PointsSummary)
_READERS: dict[str, Callable[..., ReferencePoints]] = {".las": points_of_cloud, ".laz": points_of_cloud, ".ply": points_of_mesh}


@dataclass(frozen=True)
class PointsFile:
    """A file of the project with points: its path, the project's system, and the standard error (m) where the file states none."""

    path: str
    crs: str
    sigma: float


def point_jobs(file: PointsFile, source: str, grid: MapGrid, tile: int) -> Iterator[Job]:
    """The heights `source` on `grid`, in tiles of `tile` cells, at the points of a file."""
    yield _reading(file)
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


def _reading(file: PointsFile) -> Job:
    suffix = PurePath(file.path).suffix.lower()
    if suffix in _READERS:
        cloud = MeshFile(file.path) if suffix == ".ply" else CloudFile(file.path, file.crs)
        return Job(
            stage="evaluation",
            item="reference_points",
            function=_READERS[suffix],
            reads={"cloud": cloud},
            writes={"points": POINTS},
            params={"sigma": file.sigma},
        )
    return Job(
        stage="evaluation",
        item="reference_points",
        function=points_of_table,
        reads={"text": TextFile(file.path)},
        writes={"points": POINTS},
        params={"path": file.path, "sigma": file.sigma},
    )
