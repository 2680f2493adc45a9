"""Inspects a single photograph: reads it with the checking readers, writes a map of it as a PNG, and prints the map's histogram.

The catalogue provides the maps; this file knows only that one consists of grey levels with labels.
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
from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.schemas.errors import PhotoError, StoreError
from orthomill.schemas.inspections.inspection import PhotoFile, PhotoMap
from orthomill.schemas.marks import FoundTarget
from orthomill.schemas.photo import Header
from orthomill.schemas.raster import Window

_BAR = 40
"""length of the longest bar, characters"""


@dataclass(frozen=True)
class GuardedPhoto:
    """A photograph on disk. Its header is read once; anything but a complete photograph raises PhotoError."""

    path: Path

    @cached_property
    def header(self) -> Header:
        if not self.path.exists():
            raise PhotoError(f"The photograph {shown(self.path)} does not exist; check its name and folder.")
        return read_header(self.path).model_copy(update={"path": shown(self.path)})

    def read(self, window: Window) -> np.ndarray:
        """Pixels of a window."""
        return read_pixels(self.path, window)


def target_lines(path: Path, targets_of: Callable[[PhotoFile], tuple[FoundTarget, ...]], least: float) -> Iterator[str]:
    """The targets of a photograph, upright as it is displayed, as lines of CSV; uncoded ones with a score of `least` or more.
    Raises PhotoError."""
    found = targets_of(GuardedPhoto(path))  # before the first line: a photograph that cannot be read has no table
    yield "name,kind,col,row,sigma,radius,score"
    for one in found:
        if one.name or one.score >= least:
            col, row = one.place
            yield f"{one.name},{one.kind},{col:.3f},{row:.3f},{one.sigma:.3f},{one.radius:.1f},{one.score:.2f}"


def picture_path(photo: Path, words: str, output: Path | None) -> Path:
    """Where the picture goes: `output`, or the photograph's name with `words` in the current folder.

    Raises StoreError for a path that is not a PNG, that has no folder, or that is the photograph itself.
    """
    # Not the photograph's own folder: the next run would take the picture for one of the photographs.
    path = output or Path(f"{photo.stem}_{words}.png")
    if path.suffix.lower() != ".png":
        raise StoreError(f"The picture is a PNG, but {path} does not end in .png; choose a name that does.")
    if not path.parent.is_dir():
        raise StoreError(f"The folder {path.parent} for the picture does not exist; create it or choose another.")
    # samefile sees through links and different spellings of one path.
    if path.exists() and photo.exists() and path.samefile(photo):
        raise StoreError(f"{path} is the photograph itself, which would be overwritten; choose another name for the picture.")
    return path


def write_map(found: PhotoMap, path: Path, out: Console, err: Console) -> None:
    """Write the picture and print its histogram. Raises StoreError when the picture cannot be written."""
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
    out.print(f"{path}: {found.shape[1]} x {found.shape[0]} px, grey values as in the table", soft_wrap=True)


def _counted(strips: Iterator[np.ndarray], counts: np.ndarray, advance: Callable[[int], None]) -> Iterator[np.ndarray]:
    # Counted while the strips are written, so that the map is never in memory as a whole.
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
