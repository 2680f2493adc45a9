"""Hidden areas as masks: images of the size of the photographs' files, black where nothing is to be used.

What a photograph's own mask hides is hidden in them too, so that one folder of masks is enough for a workflow.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.image_files import read_pixels
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.marks import HiddenArea
from orthomill.schemas.photo import Photo
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.upright import from_upright, turned

MASKS = "masks"
"""folder beside the marks"""


class MaskImages:
    """The masks in a folder of the project at `root`, one for each of the `photos` that has hidden areas or a mask of its own."""

    def __init__(self, root: Path, folder: Path, photos: Iterable[Photo]) -> None:
        self._root, self._folder = root, folder
        self._photos = {photo.name: photo for photo in photos}

    @property
    def path(self) -> str:
        """The folder as workflows name it."""
        return self._folder.relative_to(self._root).as_posix()

    def write(self, areas: Iterable[HiddenArea], only: str | None = None) -> None:
        """Write the masks of all photographs, or of one; those that hide nothing any more are removed. Raises StoreError."""
        by_photo: dict[str, list[HiddenArea]] = {}
        for area in areas:
            by_photo.setdefault(area.photo, []).append(area)
        if not by_photo and not self._folder.exists():
            return
        for photo in self._photos.values() if only is None else (self._photos[only],):
            path = self._folder / f"{photo.name}.png"
            own = None if photo.mask is None or self._root / photo.mask == path else photo.mask
            if photo.name in by_photo or own:
                write_whole(path, self._image(photo, by_photo.get(photo.name, []), own))
            else:
                path.unlink(missing_ok=True)

    def _image(self, photo: Photo, areas: list[HiddenArea], own: str | None) -> bytes:
        import cv2

        mask = np.full((photo.height, photo.width), 255, np.uint8)
        for area in areas:
            cv2.fillPoly(mask, [np.rint(np.array(area.corners)).astype(np.int32)], 0)
        mask = from_upright(mask[..., None], photo.exif_orientation)[..., 0]
        if own:
            mask = np.minimum(mask, self._own(own, photo))
        return bytes(cv2.imencode(".png", mask)[1])

    def _own(self, path: str, photo: Photo) -> np.ndarray:
        """The photograph's own mask in the frame of its file."""
        upright = (photo.height, photo.width)
        size = upright if photo.mask_upright or not turned(photo.exif_orientation) else upright[::-1]
        pixels = read_pixels(self._root / path, Window(0, 0, *size)).max(axis=2, keepdims=True)
        return (from_upright(pixels, photo.exif_orientation) if photo.mask_upright else pixels)[..., 0]
