"""A part of a painted raster as image files that a browser loads one by one.

Every level has half the pixels of the one below; its tiles are made of four tiles of that, so that no more than a few tiles of
each level are in memory. Tiles without a pixel are left out, and the page knows which ones there are.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import groupby
from pathlib import Path

import numpy as np

from orthomill.schemas.maps.map_parts import LEVELS, TILE, MapLayer, level_count

QUALITY = 88
"""of pictures and ramps; codes are kept exactly"""
EFFORT = 1
"""of packing as WebP, of 6: it takes half the time of 4, OpenCV's own, and a tenth more room"""
Run = tuple[int, int, int, str]
"""(row, first column, last column, kind of file)"""


@dataclass
class TilePyramid:
    """Part (row, col) of the tiles of a layer in `folder`.

    `finest` gives the pixels (TILE, TILE, 4) of a tile, by its row and column, that the finest level is made of: of the raster
    itself, or of the level below, which other parts have written.
    """

    layer: MapLayer
    finest: Callable[[int, int], np.ndarray]
    folder: Path
    names: dict[int, list[str]] = field(default_factory=dict)
    """names of the files that were written, "row-col" with what kind of image it is, by level"""

    def write(self, row: int, col: int) -> None:
        """All tiles of the part."""
        levels = level_count((self.layer.rows, self.layer.cols))
        self._tile(min(self.layer.level + LEVELS, levels) - 1, row, col)

    def _tile(self, level: int, row: int, col: int) -> np.ndarray:
        """The tile (TILE, TILE, 4), written; transparent beyond the raster."""
        pixels = self.finest(row, col) if level == 0 else self._of_four(level, row, col)
        if covered(pixels):
            self._save(level, row, col, pixels)
        return pixels

    def _of_four(self, level: int, row: int, col: int) -> np.ndarray:
        out, half, side = np.zeros((TILE, TILE, 4), np.uint8), TILE // 2, TILE << (level - 1)
        below = self.finest if level == self.layer.level else lambda *at: self._tile(level - 1, *at)
        for down in (0, 1):
            for right in (0, 1):
                at = 2 * row + down, 2 * col + right
                if at[0] * side < self.layer.rows and at[1] * side < self.layer.cols:
                    place = np.s_[down * half : (down + 1) * half, right * half : (right + 1) * half]
                    out[place] = self._halved(below(*at))
        return out

    def _halved(self, pixels: np.ndarray) -> np.ndarray:
        import cv2

        if self.layer.picture.style == "classes":
            return pixels[::2, ::2]  # the mean of two colours of a legend is the colour of none
        half = TILE // 2, TILE // 2
        opaque = covered(pixels)
        if not opaque:
            return np.zeros((*half, 4), np.uint8)
        if opaque == TILE * TILE:
            return np.asarray(cv2.resize(pixels, half, interpolation=cv2.INTER_AREA), np.uint8)
        alpha = pixels[..., 3:].astype(np.float32)
        weighed = np.concatenate([pixels[..., :3] * (alpha / 255), alpha], axis=2)
        means = np.asarray(cv2.resize(weighed, half, interpolation=cv2.INTER_AREA), np.float32)
        colours = means[..., :3] * (255 / np.maximum(means[..., 3:], 1))
        return np.rint(np.concatenate([colours, means[..., 3:]], axis=2)).astype(np.uint8)

    def _save(self, level: int, row: int, col: int, pixels: np.ndarray) -> None:
        image, kind = self._image(pixels)
        path = self.folder / str(level) / f"{row}-{col}{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(image)
        self.names.setdefault(level, []).append(path.name)

    def _image(self, pixels: np.ndarray) -> tuple[bytes, str]:
        """A tile (TILE, TILE, 4) as an image file, and its kind."""
        if self.layer.picture.style == "classes":
            # Of lossless images quality is one more effort, from which colours of a legend gain nothing.
            return _webp(pixels, lossless=True, quality=0), ".webp"
        if covered(pixels) < TILE * TILE:
            return _webp(pixels, lossless=False, quality=QUALITY), ".webp"
        import cv2

        # A tenth of the time of WebP; it knows no transparent pixels.
        colours = cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGR)
        return cv2.imencode(".jpg", colours, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes(), ".jpg"


def _webp(pixels: np.ndarray, lossless: bool, quality: int) -> bytes:
    # Not by OpenCV, which cannot be told how much effort packing is worth.
    from PIL import Image

    packed = BytesIO()
    Image.fromarray(pixels).save(packed, "WEBP", lossless=lossless, quality=quality, method=EFFORT)
    return packed.getvalue()


def pixels_of(image: bytes) -> np.ndarray:
    """A written tile (TILE, TILE, 4) uint8 as it is seen."""
    import cv2

    seen = np.asarray(cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_UNCHANGED))
    return np.asarray(cv2.cvtColor(seen, cv2.COLOR_BGRA2RGBA if seen.shape[2] == 4 else cv2.COLOR_BGR2RGBA), np.uint8)


def covered(pixels: np.ndarray) -> int:
    """How many pixels (rows, cols, 4) uint8 are opaque, a little or whole."""
    import cv2

    return cv2.countNonZero(cv2.extractChannel(pixels, 3))


def runs_of(names: tuple[str, ...]) -> Iterator[Run]:
    """Tiles side by side of one kind, of names "row-col" with their kind of file, by row and column: short for the page."""
    tiles = sorted(map(_tile, names))
    for (_, row, kind), run in groupby(enumerate(tiles), key=lambda one: (one[1][1] - one[0], one[1][0], one[1][2])):
        columns = [tile[1] for _, tile in run]
        yield row, columns[0], columns[-1], kind


def _tile(name: str) -> tuple[int, int, str]:
    row, col = Path(name).stem.split("-")
    return int(row), int(col), Path(name).suffix
