"""Five points of the ground as a surveyor would hand them over, from the adjustment of the flight before it is altered.

They fit the photographs better than any survey does, so that whatever is said of an altered list is said of what was altered.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from rasterio.warp import transform

from benchmarks.measured_run import orthomill
from benchmarks.orientation.circumstances.altered_photographs import Altered, Flown
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.observations import GROUND_POINTS, TIE_POINTS
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS

POINTS, RAYS = 5, 3
"""points, and photographs that measured each at least"""
_ACROSS = (
    lambda x, y: x + y,
    lambda x, y: -x - y,
    lambda x, y: x - y,
    lambda x, y: y - x,
    lambda x, y: -np.hypot(x - np.median(x), y - np.median(y)),
)
"""What is largest at the corners of the block, and in its middle"""


@dataclass(frozen=True)
class Mark:
    """A point in a photograph: coordinates (m), place (px, centre of the upper-left pixel is (0, 0)), file and point."""

    x: float
    y: float
    z: float
    col: float
    row: float
    file: str
    point: str


Change = Callable[[Mark], dict[str, object]]
"""What stands otherwise in the line of a mark, by the names of `Mark`"""


def unchanged(mark: Mark) -> dict[str, object]:
    """Nothing."""
    return {}


@dataclass(frozen=True)
class Survey:
    """The unaltered block and the marks of the points in it."""

    block: Block
    marks: tuple[Mark, ...]

    def listed(self, line: str, change: Change = unchanged, crs: str = "") -> str:
        """A list with the `line` of every mark, after `change`, in the system `crs` (that of the block without one)."""
        rows = []
        for mark in self.marks:
            x, y = self._plan(mark, crs)
            rows.append(line.format(**(vars(mark) | {"x": x, "y": y} | change(mark))))
        return "\n".join(rows) + "\n"

    def _plan(self, mark: Mark, crs: str) -> tuple[float, float]:
        if not crs:
            return mark.x, mark.y
        (x,), (y,) = transform(self.block.crs, crs, [mark.x], [mark.y])
        return x, y


@cache
def surveyed(flown: Flown, numbers: Sequence[int]) -> Survey:
    """The survey of the photographs with these numbers."""
    with tempfile.TemporaryDirectory(prefix="orthomill_survey_") as folder:
        root = Path(folder)
        flown.written(root / "photos", Altered(numbers))
        for words in (("init", "site", "--photos", "photos"), ("run", "site", "--until", "orientation", "--sequential")):
            done = orthomill(root, *words)
            if done.code:
                raise RuntimeError(f"orthomill {words[0]} of the unaltered photographs ended with {done.code}:\n{done.output}")
        store = Store(root / "runs" / "site")
        return Survey(store.table(BLOCK), _marks(store))


def _marks(store: Store) -> tuple[Mark, ...]:
    ground, ties = store.table(GROUND_POINTS), store.table(TIE_POINTS)
    files = [Path(photo.path).name for photo in store.table(PHOTOS).photos]
    seen = np.flatnonzero(ground.rays >= RAYS)
    chosen = dict.fromkeys(int(seen[np.argmax(value(ground.x[seen], ground.y[seen]))]) for value in _ACROSS)
    return tuple(
        Mark(
            ground.x[point],
            ground.y[point],
            ground.z[point],
            ties.col[ray],
            ties.row[ray],
            files[ties.photo[ray]],
            f"gcp{number + 1}",
        )
        for number, point in enumerate(chosen)
        for ray in np.flatnonzero(ties.track == ground.track[point])
    )
