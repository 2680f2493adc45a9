"""A chain of three small stages to exercise the engine (tables, tiles with halos, planning in steps, failures), and its runs."""

import os
import time
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import BaseModel

from orthomill.pipeline.engine.runner import Runner, SequentialRunner
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Export, Job, Raster, Table
from orthomill.schemas.project import Project
from orthomill.schemas.raster import RasterSpec, Window, tiles_of
from orthomill.schemas.stage_contract import Stage


class Size(BaseModel):
    rows: int
    cols: int


class Total(BaseModel):
    total: float


SIZE = Table("source/size.json", Size)
TOTAL = Table("sum/total.json", Total)


def make_size(rows: int, cols: int) -> Size:
    return Size(rows=rows, cols=cols)


def make_tile(window: Window, factor: float, pause: float, poison: tuple[int, int] | None, lure: str) -> np.ndarray:
    if lure and Path(lure).exists():
        Path(lure).unlink()
        os._exit(9)
    if poison == (window.row, window.col):
        raise GeometryError("this tile is poisoned; take another one.")
    time.sleep(pause)
    rows, cols = np.mgrid[window.slices]
    return (factor * (rows * 1000 + cols)).astype(np.float32)


def smooth_tile(values: np.ndarray, read: Window, window: Window) -> np.ndarray:
    padded = np.pad(values, 1, mode="edge")
    rows, cols = values.shape
    mean = sum(padded[i : rows + i, j : cols + j] for i in range(3) for j in range(3)) / np.float32(9)
    top, left = window.row - read.row, window.col - read.col
    return mean[top : top + window.height, left : left + window.width].astype(np.float32)


def add_up(parts: tuple[np.ndarray, ...]) -> Total:
    return Total(total=float(sum(part.astype(np.float64).sum() for part in parts)))


class SourceStage(Stage):
    """Makes numbers."""

    title: ClassVar[str] = "making numbers"
    kind: Literal["source"] = "source"
    rows: int = 200
    cols: int = 150
    factor: float = 1.0
    pause: float = 0.0
    poison: tuple[int, int] | None = None
    lure: str = ""

    def plan(self, view):
        yield Job(
            stage="source",
            item="size",
            function=make_size,
            reads={},
            writes={"size": SIZE},
            params={"rows": self.rows, "cols": self.cols},
        )
        size = view.table(SIZE)
        spec = RasterSpec(name="source/numbers", shape=(size.rows, size.cols), dtype="float32", chunk=view.project.tile)
        yield spec
        for tile in tiles_of(spec.shape, view.project.tile):
            params = {"window": tile.window, "factor": self.factor, "pause": self.pause, "poison": self.poison, "lure": self.lure}
            yield Job(
                stage="source",
                item="tile",
                function=make_tile,
                reads={},
                writes={"numbers": Raster(spec.name, tile.window)},
                params=params,
                row=tile.row,
                col=tile.col,
            )


class SmoothStage(Stage):
    """Smooths them."""

    title: ClassVar[str] = "smoothing"
    kind: Literal["smooth"] = "smooth"
    strength: float = 1.0

    def plan(self, view):
        source = view.raster("source/numbers")
        spec = RasterSpec(name="smooth/numbers", shape=source.shape, dtype="float32", chunk=view.project.tile)
        yield spec
        for tile in tiles_of(spec.shape, view.project.tile):
            read = tile.window.grown(1).clipped(spec.shape)
            yield Job(
                stage="smooth",
                item="tile",
                function=smooth_tile,
                reads={"values": Raster(source.name, read)},
                writes={"mean": Raster(spec.name, tile.window)},
                params={"read": read, "window": tile.window},
                row=tile.row,
                col=tile.col,
            )
        yield Export("smooth", "file", "products/smooth.tif", "tiff", rasters={"value": spec.name})


class SumStage(Stage):
    """Adds them up."""

    title: ClassVar[str] = "adding up"
    kind: Literal["sum"] = "sum"

    def plan(self, view):
        spec = view.raster("smooth/numbers")
        regions = tuple(Raster(spec.name, tile.window) for tile in tiles_of(spec.shape, view.project.tile))
        yield Job(stage="sum", item="total", function=add_up, reads={"parts": regions}, writes={"total": TOTAL})


CATALOGUE = (SourceStage, SmoothStage, SumStage)

MEMORY = 1500 * 2**20
PROJECT = Project.model_validate({"project": "toy", "crs": "EPSG:2100", "photographs": {"kind": "folder", "path": "photos"}})


def session_in(root: Path, *stages: Stage, tile: int = 128, forced: frozenset[str] = frozenset()) -> Session:
    """A session of the toy project in runs/toy below `root`; without `stages`, all three with their defaults."""
    project = PROJECT.model_copy(update={"tile": tile})
    return Session(project, stages or (SourceStage(), SmoothStage(), SumStage()), root, lambda source: (), forced)


def run_in(root: Path, *stages: Stage, runner: Runner | None = None, **more) -> Session:
    """Run the toy project; returns the session when it has ended."""
    session = session_in(root, *stages, **more)
    session.run(runner or SequentialRunner(MEMORY), Unwatched())
    return session


def pixels(root: Path, name: str = "smooth/numbers") -> np.ndarray:
    """A whole raster of the run."""
    store = Store(root / "runs" / "toy")
    return store.read(name, store.spec(name).full)
