"""Hidden areas as masks: images of the size of the photographs' files, black where nothing is to be used.

What a photograph's own mask hides is hidden in them too, so that one folder of masks is enough for a workflow.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.marks import HiddenArea
from orthomill.schemas.photo import Photo
from orthomill.schemas.raster import Window

MASKS = "masks"
"""folder beside the marks"""
MaskOf = Callable[[Photo, Iterable[HiddenArea], np.ndarray | None], np.ndarray]
"""The mask of a photograph by its hidden areas and its own mask."""


class MaskImages:
    """The masks in a folder of the project at `root`, one for each of the `photos` that has hidden areas or a mask of its own;
    `mask_of` draws them."""

    def __init__(self, root: Path, folder: Path, photos: Iterable[Photo], mask_of: MaskOf) -> None:
        self._root, self._folder, self._mask_of = root, folder, mask_of
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

        return bytes(cv2.imencode(".png", self._mask_of(photo, areas, self._pixels(own) if own else None))[1])

    def _pixels(self, path: str) -> np.ndarray:
        header = read_header(self._root / path)
        return read_pixels(self._root / path, Window(0, 0, header.height, header.width))
