"""A project that has been run, as a notebook reads it: tables as typed values, rasters as lazy xarray arrays."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.surface_answers import MeasuredAnswers
from orthomill.schemas.camera import CAMERAS, Camera
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Table
from orthomill.schemas.observations import GROUND_POINTS, IMAGE_RESIDUALS, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photos

T = TypeVar("T")


@dataclass(frozen=True)
class FinishedProject:
    """What a run left in its folder. Nothing is read before it is asked for, and nothing is written."""

    folder: Path

    @property
    def _store(self) -> Store:
        return Store(self.folder)

    @cached_property
    def photographs(self) -> Photos:
        """The photographs: names, sizes, cameras, positions. Raises StoreError before the stage `photos` has run."""
        return self.table(PHOTOS)

    @cached_property
    def cameras(self) -> dict[str, Camera]:
        """Cameras by name, as adjusted in the block; as calibrated where there is no block yet. Raises StoreError."""
        store = self._store
        return self.block.cameras if store.has_table(BLOCK) else self.table(CAMERAS).cameras

    @cached_property
    def block(self) -> Block:
        """Exterior orientations with covariances, cameras, sigma0 (px). Raises StoreError before `orientation` has run."""
        return self.table(BLOCK)

    @cached_property
    def points(self) -> GroundPoints:
        """Adjusted tie points with their covariances, in metres of the project's CRS. Raises StoreError."""
        return self.table(GROUND_POINTS)

    @cached_property
    def image_residuals(self) -> ImageResiduals:
        """Residuals of the image measurements, px. Raises StoreError."""
        return self.table(IMAGE_RESIDUALS)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Every figure of the report under its stable name (docs/summary.md). Raises StoreError."""
        path = self.folder / "summary.json"
        if not path.exists():
            raise StoreError(f"{path} does not exist; run the project to its end first.")
        return json.loads(path.read_text())

    def covariance(self, photo: str) -> np.ndarray:
        """Covariance (6, 6) of X, Y, Z (m) and omega, phi, kappa (radians) of a photograph.

        Raises StoreError when the photograph is not in the block, or its orientation was fixed and has none.
        """
        if photo not in self.block.names:
            raise StoreError(f"{photo} is not in the block of {self.folder.name}; it holds {', '.join(self.block.names[:8])} ...")
        covariance = self.block.of(photo).covariance
        if covariance is None:
            raise StoreError(f"The exterior orientation of {photo} was fixed, so that no covariance was estimated.")
        return np.array(covariance)

    def measure(self, features: str | Path, base: str = "border", corner: float | None = None) -> MeasuredAnswers:
        """Heights, lines, areas and volumes of the features of a file (GeoPackage, GeoJSON, CSV), each with its standard error, as
        `orthomill measure` gives them. base: border, a level in m, a file or the folder of a run; corner: standard error of a
        corner, m. Raises StoreError, WorkflowError and GeometryError."""
        # A notebook that only looks at figures loads no methods.
        from orthomill.pipeline.cli.lookups.measured_answers import MeasureOptions, measured_answers
        from orthomill.tasks.lookups import measure

        return measured_answers(self.folder, Path(features), MeasureOptions(base, False, corner, None, None), measure)

    @property
    def rasters(self) -> tuple[str, ...]:
        """Names of all rasters, sorted: "densification/height", "texture/ortho", "photos/<photo>/<level>" ..."""
        return self._store.names()

    def raster(self, name: str) -> xr.DataArray:
        """A raster as a lazy array, chunked as it is stored.

        Dimensions are (y, x) for maps and (row, col) for images, with `band` behind where there are several. Maps carry the
        centres of their cells (m) and the CRS (`import rioxarray; array.rio.crs`). Raises StoreError for an unknown name.
        """
        spec = self._store.spec(name)
        group, _, leaf = name.rpartition("/")
        # coordinates of the whole group come along; those of other grids in it are left behind
        data = xr.open_zarr(self._store.rasters, group=group, consolidated=False, decode_coords="all", mask_and_scale=False)[leaf]
        data = data.drop_vars([c for c in data.coords if not set(data[c].dims) <= set(data.dims)])
        names = ("y", "x") if spec.transform else ("row", "col")
        return data.rename(dict(zip(map(str, data.dims), (*names, "band"), strict=False))).rename(name)

    def table(self, table: Table[T]) -> T:
        """The value of any table, such as `orthomill.schemas.orientation.RELATIVE`. Raises StoreError when it is not there."""
        if not self._store.has_table(table):
            stage = table.path.split("/")[0]
            raise StoreError(f"{self.folder.name} has no table {table.path}; run its stage '{stage}' first.")
        return self._store.table(table)


def open(folder: str | Path) -> FinishedProject:
    """The project in a run's folder, such as "runs/volos". Raises StoreError when no run is there."""
    path = Path(folder)
    if not (path / "tables").is_dir():
        raise StoreError(f"{path} is not the folder of a run; give one such as runs/volos, where 'orthomill run' has left results.")
    return FinishedProject(path)
