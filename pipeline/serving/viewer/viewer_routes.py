"""The paths of the map of a run on this machine: its page and tiles as they lie on the disk, and photographs that show a place."""

import mimetypes
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from tornado.ioloop import IOLoop
from tornado.web import RequestHandler, StaticFileHandler

from orthomill.pipeline.serving.marking.photograph_crops import PhotographCrops
from orthomill.pipeline.serving.page_answers import PageAnswer
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import CORRECTED, HEIGHT, SURFACE

AROUND = 300
"""cells around a place whose heights can hide it"""
MOST_PHOTOGRAPHS = 24
PhotographsOf = Callable[[Block, tuple[float, float, float], MapGrid, np.ndarray], Sequence[Any]]


class PlaceAnswers:
    """What is known of a place beside what its tiles say: the photographs that show it."""

    def __init__(self, store: Store, photographs_of: PhotographsOf) -> None:
        """Raises StoreError for a run without a surface."""
        self._store, self._photographs_of = store, photographs_of
        self._block, self._grid = store.table(BLOCK), store.table(SURFACE).grid
        self._heights = CORRECTED if CORRECTED in store.names() else HEIGHT
        self.crops = PhotographCrops(store, store.table(PHOTOS))

    def photographs(self, x: float, y: float) -> list[dict[str, Any]]:
        """The photographs that show the surface at a place (x, y) m; none where it has no height."""
        grid = self._grid
        col, row = (int(np.rint(value)) for value in grid.pixel(x, y))
        if not (0 <= row < grid.rows and 0 <= col < grid.cols):
            return []
        window = Window(row, col, 1, 1).grown(AROUND).clipped(grid.shape)
        heights = self._store.read(self._heights, window)
        z = float(heights[row - window.row, col - window.col])
        if not np.isfinite(z):
            return []
        corner = grid.west + window.col * grid.cell, grid.north - window.row * grid.cell
        part = MapGrid(west=corner[0], north=corner[1], cell=grid.cell, rows=window.height, cols=window.width)
        found = self._photographs_of(self._block, (x, y, z), part, heights)
        return [asdict(one) for one in found[:MOST_PHOTOGRAPHS]]


class _AskedOfPlace(PageAnswer):
    def initialize(self, answers: PlaceAnswers) -> None:
        self.answers = answers


class _PhotographsOfPlace(_AskedOfPlace):
    async def get(self) -> None:
        place = self.number("x", -1e9, 1e9), self.number("y", -1e9, 1e9)
        self.tell(await IOLoop.current().run_in_executor(None, self.answers.photographs, *place))


class _PatchOfPlace(_AskedOfPlace):
    async def get(self) -> None:
        size = self.side("size")
        await self.show(self.answers.crops, (size, size))


class _ProductFile(StaticFileHandler):
    """Files as they are, whole or in ranges of bytes, which maps of one large file ask for."""

    def get_content_type(self) -> str:
        kind = mimetypes.guess_type(self.absolute_path or "")[0]
        return {".webp": "image/webp", ".pmtiles": "application/octet-stream"}.get(
            Path(self.absolute_path or "").suffix, kind or "application/octet-stream"
        )


def viewer_routes(products: Path, answers: PlaceAnswers) -> list[tuple[str, type[RequestHandler], dict[str, Any]]]:
    """Routes for an application of tornado, below its secret; the page ends in /index.html."""
    asked = {"answers": answers}
    return [
        (r"/[^/]+/place\.json", _PhotographsOfPlace, asked),
        (r"/[^/]+/crop\.jpg", _PatchOfPlace, asked),
        (r"/[^/]+/(.*)", _ProductFile, {"path": str(products)}),
    ]


def map_of(run: Path) -> Path:
    """The folder of products with the map of a run. Raises StoreError for a run without one."""
    products = run / "products"
    if not (products / "index.html").is_file():
        raise StoreError(
            f"{run.name} has no map yet: add '- kind: viewer' to its workflow where it has none, then: orthomill run {run.name}"
        )
    return products
