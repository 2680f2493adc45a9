"""An orthoimage as tiles of the web: a folder z/x/y, MBTiles or PMTiles, in Web Mercator.

Source: OGC 17-083r4, WebMercatorQuad; MBTiles 1.3; PMTiles 3.
"""

import json
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from math import atan, ceil, degrees, exp, floor, log2, pi
from pathlib import Path

import numpy as np
from rasterio.windows import Window

from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.conversions.warped_product import warped
from orthomill.schemas.errors import WorkflowError

SIDE = 256
"""px along a tile"""
HALF = pi * 6378137.0
"""half of the width of the world, m"""
QUALITY = 85
Sink = Callable[[int, int, int, bytes], None]
"""takes zoom, column, row (from the north) and the picture of a tile"""


def finest_zoom(cell: float) -> int:
    """The zoom whose pixels are about as large as a cell of so many metres of Web Mercator."""
    return round(log2(2 * HALF / SIDE / cell))


def write_tiles(product: Path, path: Path, kind: str, cutline: Path | None = None) -> None:
    """The tiles of a picture at `path`; kind: xyz, mbtiles, pmtiles; only what is inside a cutline.

    Raises WorkflowError for what is no picture."""
    with warped(product, Wanted(crs="EPSG:3857", cutline=cutline)) as view:
        if view.dtypes[0] != "uint8" or view.count < 3:
            raise WorkflowError(f"{product.name} is no picture of 8 bits, so it has no tiles; ask for those of the orthoimage.")
        zoom, bounds = finest_zoom(view.transform.a), view.bounds
    cell = 2 * HALF / SIDE / 2**zoom
    low = floor((bounds.left + HALF) / (SIDE * cell)), floor((HALF - bounds.top) / (SIDE * cell))
    high = ceil((bounds.right + HALF) / (SIDE * cell)), ceil((HALF - bounds.bottom) / (SIDE * cell))
    area = (low[0] * SIDE * cell - HALF, HALF - high[1] * SIDE * cell, high[0] * SIDE * cell - HALF, HALF - low[1] * SIDE * cell)
    least = max(zoom - ceil(log2(max(high[0] - low[0], high[1] - low[1], 1))), 0)
    about = {"name": product.stem, "minzoom": least, "maxzoom": zoom, "bounds": _degrees(bounds)}
    with warped(product, Wanted("EPSG:3857", area, cell, cutline)) as view:
        bands = list(range(1, min(view.count, 4) + 1))

        def read(x: int, y: int) -> np.ndarray:
            window = Window((x - low[0]) * SIDE, (y - low[1]) * SIDE, SIDE, SIDE)
            pixels = np.moveaxis(view.read(window, bands), 0, -1)
            alpha = pixels[..., 3:] if pixels.shape[2] == 4 else np.where(view.seen(window), 255, 0).astype(np.uint8)[..., None]
            return np.concatenate([pixels[..., :3], alpha], axis=-1)

        pyramid = _Pyramid(read, (low, high), zoom, _SINKS[kind](path, about))
        for root in pyramid.roots(least):
            pyramid.tile(least, *root)
        pyramid.sink.close()


def _degrees(bounds: tuple[float, float, float, float]) -> list[float]:
    """West, south, east, north in degrees."""
    x = [value / HALF * 180.0 for value in (bounds[0], bounds[2])]
    y = [degrees(2 * atan(exp(value / 6378137.0)) - pi / 2) for value in (bounds[1], bounds[3])]
    return [x[0], y[0], x[1], y[1]]


class _Pyramid:
    """Tiles made from the finest ones, depth first, so that a few are in memory."""

    def __init__(self, read: Callable[[int, int], np.ndarray], extent: tuple, zoom: int, sink: "_Folder") -> None:
        self.read, self.extent, self.zoom, self.sink = read, extent, zoom, sink

    def roots(self, least: int) -> Iterator[tuple[int, int]]:
        shift = self.zoom - least
        (left, top), (right, bottom) = self.extent
        for x in range(left >> shift, ((right - 1) >> shift) + 1):
            for y in range(top >> shift, ((bottom - 1) >> shift) + 1):
                yield x, y

    def tile(self, zoom: int, x: int, y: int) -> np.ndarray | None:
        """The pixels (256, 256, 4) of a tile, which is kept; None outside the picture."""
        shift = self.zoom - zoom
        (left, top), (right, bottom) = self.extent
        if not ((left >> shift) <= x <= ((right - 1) >> shift) and (top >> shift) <= y <= ((bottom - 1) >> shift)):
            return None
        pixels = self.read(x, y) if shift == 0 else self._of_four(zoom, x, y)
        if pixels[..., 3].any():
            self.sink.add(zoom, x, y, _encoded(pixels))
        return pixels

    def _of_four(self, zoom: int, x: int, y: int) -> np.ndarray:
        whole = np.zeros((2 * SIDE, 2 * SIDE, 4), np.float32)
        for down in (0, 1):
            for right in (0, 1):
                part = self.tile(zoom + 1, 2 * x + right, 2 * y + down)
                if part is not None:
                    whole[down * SIDE : (down + 1) * SIDE, right * SIDE : (right + 1) * SIDE] = part
        four = whole.reshape(SIDE, 2, SIDE, 2, 4)
        alpha = four[..., 3:].sum(axis=(1, 3))
        colours = (four[..., :3] * four[..., 3:]).sum(axis=(1, 3)) / np.maximum(alpha, 1)
        return np.rint(np.concatenate([colours, alpha / 4], axis=-1)).astype(np.uint8)


def _encoded(pixels: np.ndarray) -> bytes:
    import cv2

    picture = np.ascontiguousarray(pixels[..., [2, 1, 0, 3]])
    return bytes(cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes())


class _Folder:
    """Tiles as files z/x/y.webp."""

    def __init__(self, path: Path, about: dict) -> None:
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir(parents=True)
        self.path = path
        (path / "tiles.json").write_text(json.dumps({"tilejson": "3.0.0", "tiles": ["{z}/{x}/{y}.webp"], **about}))

    def add(self, zoom: int, x: int, y: int, data: bytes) -> None:
        place = self.path / str(zoom) / str(x)
        place.mkdir(parents=True, exist_ok=True)
        (place / f"{y}.webp").write_bytes(data)

    def close(self) -> None:
        """Nothing is left to do."""


class _MbTiles(_Folder):
    """Tiles in a database, rows counted from the south."""

    def __init__(self, path: Path, about: dict) -> None:
        path.unlink(missing_ok=True)
        self.base = sqlite3.connect(path)
        self.base.executescript(
            "CREATE TABLE metadata (name TEXT, value TEXT);"
            "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB);"
            "CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row);"
        )
        rows = {**about, "bounds": ",".join(f"{value:.8f}" for value in about["bounds"]), "format": "webp", "type": "overlay"}
        self.base.executemany("INSERT INTO metadata VALUES (?, ?)", [(name, str(value)) for name, value in rows.items()])

    def add(self, zoom: int, x: int, y: int, data: bytes) -> None:
        self.base.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (zoom, x, 2**zoom - 1 - y, data))

    def close(self) -> None:
        self.base.commit()
        self.base.close()


class _PmTiles(_Folder):
    """Tiles in one file that a server of plain files is enough for; they must come in the order of their numbers."""

    def __init__(self, path: Path, about: dict) -> None:
        self.path, self.about = path, about
        # Kept on the disk until all are there: those of a large orthoimage are gigabytes.
        self.kept = path.with_name(f"{path.name}.kept").open("w+b")
        self.parts: list[tuple[int, int, int]] = []
        """number, place and size of each tile"""

    def add(self, zoom: int, x: int, y: int, data: bytes) -> None:
        from pmtiles.tile import zxy_to_tileid

        self.parts.append((zxy_to_tileid(zoom, x, y), self.kept.tell(), len(data)))
        self.kept.write(data)

    def close(self) -> None:
        from pmtiles.tile import Compression, TileType
        from pmtiles.writer import Writer

        west, south, east, north = (round(value * 1e7) for value in self.about["bounds"])
        with self.path.open("wb") as target:
            writer = Writer(target)
            for number, at, size in sorted(self.parts):
                self.kept.seek(at)
                writer.write_tile(number, self.kept.read(size))
            header = {
                "tile_type": TileType.WEBP,
                "tile_compression": Compression.NONE,
                "min_zoom": self.about["minzoom"],
                "max_zoom": self.about["maxzoom"],
                "min_lon_e7": west,
                "min_lat_e7": south,
                "max_lon_e7": east,
                "max_lat_e7": north,
                "center_zoom": self.about["minzoom"],
                "center_lon_e7": (west + east) // 2,
                "center_lat_e7": (south + north) // 2,
            }
            writer.finalize(header, {"name": self.about["name"]})
        self.kept.close()
        Path(self.kept.name).unlink()


_SINKS = {"xyz": _Folder, "mbtiles": _MbTiles, "pmtiles": _PmTiles}
