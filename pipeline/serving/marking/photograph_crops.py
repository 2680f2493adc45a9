"""Parts of photographs for the page: read from the pyramid of the run, so that a part costs what it shows and not what it is of."""

from functools import lru_cache

import numpy as np

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.photo import Photo, Photos, photo_raster
from orthomill.schemas.raster import Window

LARGEST = 2048
"""px: side of the largest part that is answered"""
QUALITY = 88
ROOM = 3
"""px around a part, for the interpolation at its border"""


class PhotographCrops:
    """The photographs of a run as the page shows them."""

    def __init__(self, store: Store, photos: Photos) -> None:
        self._store = store
        self.photos = {photo.name: photo for photo in photos.photos}
        self._range = lru_cache(maxsize=None)(self._grey_range)

    def jpeg(self, name: str, col: float, row: float, scale: float, size: tuple[int, int]) -> bytes | None:
        """A part of `size` (width, height) px about (col, row) of a photograph, `scale` screen pixels per pixel; None for a
        photograph that there is not."""
        import cv2

        photo = self.photos.get(name)
        if photo is None:
            return None
        shown = self._shown(photo, (col, row), scale, size)
        return bytes(cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])

    def pixels(self, name: str) -> np.ndarray:
        """(rows, cols, bands) of a whole photograph; 0 where it is masked."""
        photo = self.photos[name]
        found = self._store.read(photo_raster(name), self._store.spec(photo_raster(name)).full)
        shown = found[..., -1:] > 0 if photo.masked else True
        return np.where(shown, found[..., : photo.bands], np.zeros((), found.dtype))

    def grey(self, name: str, window: Window) -> np.ndarray:
        """(height, width) float32 of a window of a photograph, NaN outside of it."""
        photo = self.photos[name]
        inside = window.clipped((photo.height, photo.width))
        out = np.full(window.shape, np.nan, np.float32)
        if not inside.empty:
            pixels = self._store.read(photo_raster(name), inside)
            colours = pixels[..., : photo.bands].astype(np.float32)
            grey = colours.mean(axis=2) if colours.ndim == 3 else colours
            first = inside.row - window.row, inside.col - window.col
            out[first[0] : first[0] + inside.height, first[1] : first[1] + inside.width] = grey
        return out

    def _shown(self, photo: Photo, at: tuple[float, float], scale: float, size: tuple[int, int]) -> np.ndarray:
        import cv2

        level = int(np.clip(np.floor(-np.log2(max(scale, 1e-6))), 0, photo.levels - 1))
        step = 2.0**level
        spec = self._store.spec(photo_raster(photo.name, level)).full
        # Centres of pixels have whole numbers: halving a photograph moves them by a half.
        centre = (np.array(at) + 0.5) / step - 0.5
        reach = np.array(size) / (2.0 * scale * step)
        low, high = np.floor(centre - reach).astype(int) - ROOM, np.ceil(centre + reach).astype(int) + ROOM
        window = Window(row=int(low[1]), col=int(low[0]), height=int(high[1] - low[1]), width=int(high[0] - low[0]))
        window = window.clipped(spec.shape)
        if window.empty:
            return np.full((size[1], size[0], 3), 40, np.uint8)
        pixels = self._as_bytes(photo, self._store.read(photo_raster(photo.name, level), window))
        each = scale * step
        # From the pixels of the part to those that were read.
        to_source = np.array(
            [
                [1 / each, 0, centre[0] - (size[0] - 1) / (2 * each) - window.col],
                [0, 1 / each, centre[1] - (size[1] - 1) / (2 * each) - window.row],
            ]
        )
        way = cv2.INTER_NEAREST if scale >= 6 else cv2.INTER_LINEAR
        return cv2.warpAffine(pixels, to_source, size, flags=way | cv2.WARP_INVERSE_MAP, borderValue=(40, 40, 40))

    def _as_bytes(self, photo: Photo, pixels: np.ndarray) -> np.ndarray:
        """(rows, cols, 3) uint8, blue first."""
        colours = pixels[..., : photo.bands] if pixels.ndim == 3 else pixels[..., None]
        if colours.shape[2] != 3:
            colours = np.repeat(colours[..., :1], 3, axis=2)
        if colours.dtype != np.uint8:
            low, high = self._range(photo.name)
            colours = np.clip((colours.astype(np.float32) - low) * (255.0 / max(high - low, 1e-6)), 0, 255).astype(np.uint8)
        return np.ascontiguousarray(colours[..., ::-1])

    def _grey_range(self, name: str) -> tuple[float, float]:
        """The grey values between which most of a photograph lies."""
        coarsest = photo_raster(name, self.photos[name].levels - 1)
        pixels = self._store.read(coarsest, self._store.spec(coarsest).full)[..., : self.photos[name].bands]
        low, high = np.percentile(pixels, (0.5, 99.5))
        return float(low), float(high)
