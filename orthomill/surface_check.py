"""The check of a surface against photographs without a project: where it disagrees with them, and by how much."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import xarray as xr
from pyproj import CRS

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Table
from orthomill.schemas.observations import IMAGE_RESIDUALS, ImageResiduals
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.project import PhotoList, Project
from orthomill.schemas.raster import MapGrid, map_raster
from orthomill.schemas.stage_report import StageReport, report_table
from orthomill.schemas.surface import CORRECTED, HEIGHT, PROVENANCE, SURFACE, Provenance
from orthomill.tasks.dsm_check.report.check_report import DH, PRECISION
from orthomill.tasks.dsm_check.stage import DsmCheckStage, SurfaceFile
from orthomill.tasks.dsm_check.surfaces.foreign_grid import surface_on
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.photos.stage import PhotosStage
from orthomill.temporary_run import GivenResults, Progress, photo_list, temporary_run

# A block alone tells nothing of its tie points; the y-parallaxes of its pairs are then those that its covariances predict.
_NO_RESIDUALS = ImageResiduals(
    *(np.zeros(0, kind) for kind in (np.int32, np.int32, np.float64, np.float64, np.float32, np.float32, np.float32, np.bool_))
)
_TILE = 512
"""Side of the pieces in which the surface is handed over, cells."""


@dataclass(frozen=True)
class SurfaceCheck:
    """The answer, on the cells of the surface."""

    result: xr.Dataset
    """dh: correction that the photographs ask for (m, NaN where they cannot judge); sigma: its standard error (m); height: the
    corrected surface (m)"""
    report: StageReport
    """figures, charts, maps and warnings as in the report of a project"""


def check(
    surface: str | Path | xr.DataArray,
    photographs: str | Path | Sequence[str | Path],
    block: Block,
    *,
    settings: DsmCheckStage | None = None,
    progress: Progress | None = None,
) -> SurfaceCheck:
    """Check a height model against oriented photographs.

    surface: a GeoTIFF, or an array (y, x) of heights in metres whose coordinates x, y are the centres of square cells in the CRS of
    the block, north up, NaN where it has no height. photographs: a folder or files, named as in the block. block: from
    `orthomill.orient` or `FinishedProject.block`. settings: the stage with settings other than its defaults.

    Raises OrthomillError with one sentence, for example when no pair of photographs sees the surface.
    """
    files = photo_list(photographs)
    block = _part_of(block, files)
    project = Project(project="check", crs=block.crs, photographs=files)
    stage, given = settings or DsmCheckStage(), GivenResults.of({BLOCK: block, IMAGE_RESIDUALS: _NO_RESIDUALS})
    if isinstance(surface, xr.DataArray):
        given = _given(surface, block)
    else:
        stage = stage.model_copy(update={"surface": SurfaceFile(kind="file", path=str(Path(surface).resolve()))})
    with temporary_run(project, (PhotosStage(), given, EpipolarStage(images="none"), stage), progress) as store:
        return SurfaceCheck(_result(store), store.table(report_table("dsm_check")))


def _part_of(block: Block, files: PhotoList) -> Block:
    """The block of those of its photographs that are among the files. Raises WorkflowError where they are no pair."""
    names = {PurePath(path).stem for path in files.paths}
    there = tuple(photo for photo in block.photos if photo.photo in names)
    if len(there) < 2:
        raise WorkflowError(
            f"Of the block ({', '.join(block.names[:3])}{' ...' if len(block.names) > 3 else ''}), {len(there)} of the two "
            "photographs that a check needs are among the files; photographs have the names of their files without the suffix."
        )
    return block.model_copy(update={"photos": there})


def _result(store: Store) -> xr.Dataset:
    data = xr.open_zarr(store.rasters, group="dsm_check", consolidated=False, decode_coords="all")
    leaves = {DH: "dh", PRECISION: "sigma", CORRECTED: "height"}
    return data[[name.split("/")[1] for name in leaves]].rename({n.split("/")[1]: new for n, new in leaves.items()}).load()


def _given(surface: xr.DataArray, block: Block) -> GivenResults:
    """The surface as if the project had measured it, with the bounds of height of a surface from elsewhere."""
    grid = _grid(surface, block)
    heights = np.asarray(surface, np.float32)
    spec = map_raster(HEIGHT, grid, "float32", block.crs, _TILE, nodata=float("nan"), unit="m")
    codes = map_raster(PROVENANCE, grid, "uint8", block.crs, _TILE)
    # Nothing is known of how the heights were found; every one of them is to be judged.
    judged = np.where(np.isfinite(heights), np.uint8(Provenance.ONE_PAIR), np.uint8(Provenance.EMPTY))
    tables: dict[Table[Any], Any] = {BLOCK: block, IMAGE_RESIDUALS: _NO_RESIDUALS, SURFACE: surface_on(grid, block)}
    return GivenResults.of(tables, [(spec, heights), (codes, judged)])


def _grid(surface: xr.DataArray, block: Block) -> MapGrid:
    """The grid of the cell centres. Raises WorkflowError for another CRS, and for cells that are not square and north up."""
    mapping = surface.coords.get("spatial_ref")
    own = mapping.attrs.get("crs_wkt") if mapping is not None else None
    if own is not None and CRS(own) != CRS(block.crs):
        raise WorkflowError(f"The surface is in {CRS(own).name}, but the block in {block.crs}; reproject one of them.")
    x, y = (np.asarray(surface.coords[name], np.float64) for name in ("x", "y"))
    cell = float(x[1] - x[0])
    regular = np.allclose(np.diff(x), cell, rtol=1e-6) and np.allclose(np.diff(y), -cell, rtol=1e-6)
    if surface.dims != ("y", "x") or cell <= 0 or not regular:
        raise WorkflowError("A surface to check has the dimensions (y, x), square cells, x rising and y falling; resample it.")
    return MapGrid(west=x[0] - cell / 2, north=y[0] + cell / 2, cell=cell, rows=len(y), cols=len(x))
