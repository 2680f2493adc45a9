"""A painted raster as a pyramid of image files that a browser loads one by one.

Every level has half the pixels of the one below; its tiles are made of four tiles of that, so that no more than a few tiles of
each level are in memory. Tiles without a pixel are left out, and the page knows which ones there are.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from orthomill.pipeline.export.viewer.painted_tiles import PaintedRaster
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.raster import Window

SIZE = 512
"""px along a tile"""
QUALITY = 88
"""of pictures and ramps; codes are kept exactly"""
LOSSLESS = 101
"""in OpenCV's numbers for WebP"""


@dataclass
class TilePyramid:
    """The tiles of a raster in `folder`: level 0 has all pixels, and the last one is a single tile."""

    source: PaintedRaster
    store: ReadableStore
    folder: Path
    tiles: dict[int, list[str]] = field(default_factory=dict)
    """names of the files that were written, "row-col" with what kind of image it is, by level"""
    size: int = SIZE

    @property
    def levels(self) -> int:
        """How many there are."""
        longest, count = max(self.source.spec.shape[:2]), 1
        while longest > self.size << (count - 1):
            count += 1
        return count

    def write(self) -> None:
        """All tiles."""
        self._tile(self.levels - 1, 0, 0)

    def _tile(self, level: int, row: int, col: int) -> np.ndarray:
        """The tile (size, size, 4), written; transparent beyond the raster."""
        pixels = self._own(row, col) if level == 0 else self._of_four(level, row, col)
        if covered(pixels):
            self._save(level, row, col, pixels)
        return pixels

    def _own(self, row: int, col: int) -> np.ndarray:
        window = Window(row * self.size, col * self.size, self.size, self.size).clipped(self.source.spec.shape)
        out = np.zeros((self.size, self.size, 4), np.uint8)
        if not window.empty:
            out[: window.height, : window.width] = self.source.tile(self.store, window)
        return out

    def _of_four(self, level: int, row: int, col: int) -> np.ndarray:
        out, half = np.zeros((self.size, self.size, 4), np.uint8), self.size // 2
        rows, cols = self.source.spec.shape[:2]
        side = self.size << (level - 1)
        for down in (0, 1):
            for right in (0, 1):
                at = 2 * row + down, 2 * col + right
                if at[0] * side < rows and at[1] * side < cols:
                    place = np.s_[down * half : (down + 1) * half, right * half : (right + 1) * half]
                    out[place] = self._halved(self._tile(level - 1, *at))
        return out

    def _halved(self, pixels: np.ndarray) -> np.ndarray:
        import cv2

        if self.source.picture.style == "classes":
            return pixels[::2, ::2]  # the mean of two colours of a legend is the colour of none
        half = self.size // 2, self.size // 2
        if covered(pixels) == self.size * self.size:
            return np.asarray(cv2.resize(pixels, half, interpolation=cv2.INTER_AREA), np.uint8)
        alpha = pixels[..., 3:].astype(np.float32)
        weighed = np.concatenate([pixels[..., :3] * (alpha / 255), alpha], axis=2)
        means = np.asarray(cv2.resize(weighed, half, interpolation=cv2.INTER_AREA), np.float32)
        colours = means[..., :3] * (255 / np.maximum(means[..., 3:], 1))
        return np.rint(np.concatenate([colours, means[..., 3:]], axis=2)).astype(np.uint8)

    def _save(self, level: int, row: int, col: int, pixels: np.ndarray) -> None:
        import cv2

        colours = cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGRA)
        if self.source.picture.style == "classes":
            kind, settings = ".webp", [cv2.IMWRITE_WEBP_QUALITY, LOSSLESS]
        elif covered(pixels) == self.size * self.size:
            # A tenth of the time of WebP; it knows no transparent pixels.
            kind, settings = ".jpg", [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
            colours = cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGR)
        else:
            kind, settings = ".webp", [cv2.IMWRITE_WEBP_QUALITY, QUALITY]
        path = self.folder / str(level) / f"{row}-{col}{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(cv2.imencode(kind, colours, settings)[1].tobytes())
        self.tiles.setdefault(level, []).append(path.name)


def covered(pixels: np.ndarray) -> int:
    """How many pixels (rows, cols, 4) uint8 are opaque, a little or whole."""
    import cv2

    return cv2.countNonZero(cv2.extractChannel(pixels, 3))
