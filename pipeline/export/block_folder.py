"""The oriented photographs in a folder for another program; what they are there is made by the methods that are handed in."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Table
from orthomill.schemas.observations import CONTROL, GROUND_POINTS, IMAGE_RESIDUALS, Control, GroundPoints
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, photo_raster

QUALITY = 95
"""of JPEG"""
Files = Callable[..., Iterator[tuple[str, bytes | np.ndarray]]]


@dataclass(frozen=True)
class BlockMethods:
    """`project` gathers name, photographs, block, points, measurements and control; `files` makes the files of a program; `survey`:
    tables of block and points in the system of the survey, where the project stands on a plane."""

    project: Callable[..., Any]
    files: Files
    survey: tuple[Table[Block], Table[GroundPoints]]


def write_block(path: Path, program: str, store: Store, methods: BlockMethods) -> None:
    """The folder of a program at `path`. Raises StoreError before the photographs are oriented, WorkflowError for what the program
    cannot hold."""
    block, points = methods.survey if store.has_table(methods.survey[0]) else (BLOCK, GROUND_POINTS)
    if not store.has_table(PHOTOS) or not store.has_table(block):
        raise StoreError(f"{store.folder_name} has no oriented photographs yet; run it first: orthomill run {store.folder_name}")
    control = store.table(CONTROL) if store.has_table(CONTROL) else Control()
    tables = (store.table(PHOTOS), store.table(block), store.table(points), store.table(IMAGE_RESIDUALS), control)
    project = methods.project(store.folder_name, *tables)
    # JPEG has 8 bits.
    suffix = ".jpg" if all(photo.dtype == "uint8" for photo in tables[0].photos) else ".png"
    for file, content in methods.files(project, program, suffix, lambda name: _pixels(store, name)):
        place = path / file
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content if isinstance(content, bytes) else _encoded(content, suffix))
        if not isinstance(content, bytes) and content.shape[2] in (2, 4):
            mask = path / "masks" / f"{place.name}.png"
            mask.parent.mkdir(exist_ok=True)
            mask.write_bytes(_encoded(np.where(content[..., -1:] > 0, 255, 0).astype(np.uint8), ".png"))


def _pixels(store: Store, name: str) -> np.ndarray:
    raster = photo_raster(name)
    return store.read(raster, store.spec(raster).full)


def _encoded(pixels: np.ndarray, suffix: str) -> bytes:
    import cv2

    # A further band is the mask of the photograph; OpenCV has blue first.
    colours = pixels[..., :1] if pixels.shape[2] < 3 else pixels[..., 2::-1]
    options = [cv2.IMWRITE_JPEG_QUALITY, QUALITY] if suffix == ".jpg" else []
    return bytes(cv2.imencode(suffix, np.ascontiguousarray(colours), options)[1].tobytes())
