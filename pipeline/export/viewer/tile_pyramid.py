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
        if pixels[..., 3].any():
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
        if self.source.picture.style == "classes":
            return pixels[::2, ::2]  # the mean of two colours of a legend is the colour of none
        four = pixels.reshape(self.size // 2, 2, self.size // 2, 2, 4).astype(np.float32)
        opaque = four[..., 3:]
        alpha = opaque.sum(axis=(1, 3))
        colours = (four[..., :3] * opaque).sum(axis=(1, 3)) / np.maximum(alpha, 1)
        return np.rint(np.concatenate([colours, alpha / 4], axis=-1)).astype(np.uint8)

    def _save(self, level: int, row: int, col: int, pixels: np.ndarray) -> None:
        import cv2

        colours = np.ascontiguousarray(pixels[..., [2, 1, 0, 3]])
        if self.source.picture.style == "classes":
            kind, settings = ".webp", [cv2.IMWRITE_WEBP_QUALITY, LOSSLESS]
        elif pixels[..., 3].all():
            # A tenth of the time of WebP; it knows no transparent pixels.
            kind, settings = ".jpg", [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
            colours = np.ascontiguousarray(colours[..., :3])
        else:
            kind, settings = ".webp", [cv2.IMWRITE_WEBP_QUALITY, QUALITY]
        path = self.folder / str(level) / f"{row}-{col}{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(cv2.imencode(kind, colours, settings)[1].tobytes())
        self.tiles.setdefault(level, []).append(path.name)
