"""Looks at a single photograph: reads it through the guarded readers, writes a map of it as a PNG, and shows the map's histogram.

What the map is of, the catalogue knows.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table as Lines

from orthomill.pipeline.report.grey_png import write_grey_png
from orthomill.pipeline.storage.image_files import read_header, read_pixels, shown
from orthomill.schemas.errors import PhotoError, StoreError
from orthomill.schemas.inspection import PhotoMap
from orthomill.schemas.photo import Header
from orthomill.schemas.raster import Window

_BAR = 40
"""characters of the longest bar"""


@dataclass(frozen=True)
class GuardedPhoto:
    """A photograph on disk. Its header is read once; whatever cannot be a whole photograph raises PhotoError."""

    path: Path

    @cached_property
    def header(self) -> Header:
        if not self.path.exists():
            raise PhotoError(f"The photograph {shown(self.path)} does not exist; look at its name and its folder.")
        return read_header(self.path).model_copy(update={"path": shown(self.path)})

    def read(self, window: Window) -> np.ndarray:
        return read_pixels(self.path, window)


def picture_path(photo: Path, words: str, output: Path | None) -> Path:
    """Where the picture goes: `output`, or the photograph's name with `words` in the current folder.

    The photograph's own folder would be the wrong place: what lies there is taken for a photograph by the next run. Raises
    StoreError for a path that is no PNG, that has no folder, or that is the photograph itself.
    """
    path = output or Path(f"{photo.stem}_{words}.png")
    if path.suffix.lower() != ".png":
        raise StoreError(f"The picture is a PNG, and {path} is not called so; give a name that ends in .png.")
    if not path.parent.is_dir():
        raise StoreError(f"The folder {path.parent} for the picture does not exist; make it or choose another.")
    if path.exists() and photo.exists() and path.samefile(photo):
        raise StoreError(f"{path} is the photograph itself, which would be overwritten; choose another name for the picture.")
    return path


def write_map(found: PhotoMap, path: Path, out: Console, err: Console) -> None:
    """Write the picture and show its histogram. Raises StoreError when the picture cannot be written."""
    counts = np.zeros(256, np.int64)
    try:
        with Progress(console=err, transient=True) as progress:
            task = progress.add_task(path.name, total=found.shape[0])
            write_grey_png(path, found.shape, _counted(found.strips, counts, lambda rows: progress.advance(task, rows)))
    except OSError as error:
        raise StoreError(f"The picture {path} cannot be written ({error.strerror}); choose another folder.") from error
    out.print(_histogram(found.labels, counts))
    for note in found.notes:
        out.print(note, soft_wrap=True)
    out.print(f"{path}: {found.shape[1]} x {found.shape[0]} px, the grey values are those of the table", soft_wrap=True)


def _counted(strips: Iterator[np.ndarray], counts: np.ndarray, advance: Callable[[int], None]) -> Iterator[np.ndarray]:
    for strip in strips:
        counts += np.bincount(strip.ravel(), minlength=256)
        yield strip
        advance(len(strip))


def _histogram(labels: dict[int, str], counts: np.ndarray) -> Lines:
    lines = Lines("window", "grey value", "pixels", "", box=None)
    for column in lines.columns[:3]:
        column.justify = "right"
    total, most = max(int(counts.sum()), 1), max(int(counts.max()), 1)
    for level, label in labels.items():
        bar = "█" * round(_BAR * int(counts[level]) / most)
        lines.add_row(label, str(level), f"{100 * int(counts[level]) / total:.1f} %", bar)
    return lines
