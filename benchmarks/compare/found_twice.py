"""Whether heights that were found twice, in two sets of photographs that share none, are right: of estimates, on a simulated town.

`python -m benchmarks found_twice` flies a town with overlaps of 85 and 70 % and measures it in a folder of its own; `python -m
benchmarks found_twice RUN` takes a finished run of a simulated scene. The photographs are parted in turn, each set has a volume
of its own over the middle of the block, and the cells that the run calls estimates are looked at: how many of them both sets
find within a step of the volume, what their differences would state, and how far from the truth they are. Cells that four
photographs truly see, without the datum of the block. In crowns a height may be that of the ground below: both are visible
there.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.compare.disjoint_halves import halves
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import named_or_new_run
from orthomill.pipeline.storage.store import Store
from orthomill.schemas import truth
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import HEIGHT, MEASURED, PROVENANCE, RELATIVE_PRECISION, SURFACE, Provenance
from orthomill.tasks.densification.volume.levels import SIDE
from orthomill.tasks.evaluation.classes import place_classes
from orthomill.tasks.evaluation.grids import codes_on, heights_on, placement

PROJECT = "town_flown_twice"
_FLIGHT: dict[str, Any] = {
    "kind": "simulation",
    "frame_mm": 57.5,
    "c_mm": 38.34,
    "base_m": 54,
    "side_overlap": 0.7,
    "strips": 3,
    "photos_per_strip": 6,
    "buildings": 40,
    "board_photos": 8,
    "control": 5,
    "check": 4,
}
_STAGES = ("photos", "calibration", "tie_points", "orientation", "epipolar", "densification")
WORKFLOW = {
    "project": PROJECT,
    "crs": "EPSG:2100",
    "photographs": {"kind": "simulated"},
    "cameras": {"kind": "chessboards", "photographs": {"kind": "simulated"}, "corners": [9, 6], "square": 0.05},
    "positions": {"kind": "simulated"},
    "control": {"kind": "simulated"},
    "stages": [_FLIGHT, *({"kind": kind} for kind in _STAGES)],
}
_CODES = {Provenance.COARSE: "less sharply", Provenance.INCOHERENT: "incoherent", Provenance.INTERPOLATED: "interpolated"}
_CLASSES = {"open": (1, 2), "beside buildings": (3,), "roofs": (4, 5), "trees": (6,)}
_TREE, _OPEN = 6, (1, 2)
_SEEN, _FEWEST, _WRONG, _TILES = 4, 100, 1.0, 3
"""photographs that truly see a cell; cells without which nothing is said; m; tiles of the volume along the side of the part"""


def rows(run: Path) -> Iterator[str]:
    """The table of a run."""
    store = Store(run)
    grid = store.table(SURFACE).grid
    part = _middle(grid.shape)
    one, other, step = halves(run, part=part)
    height, stated, code = (store.read(name, part) for name in (HEIGHT, RELATIVE_PRECISION, PROVENANCE))
    place = placement(grid, part, store.table(truth.TRUTH_GRID))
    surface, ground = (heights_on(store.read(of, place.source_window), place) for of in (truth.TRUTH_SURFACE, truth.TRUTH_GROUND))
    kind = place_classes(codes_on(store.read(truth.TRUTH_MATERIAL, place.source_window), place))
    photographs = codes_on(store.read(truth.TRUTH_VISIBILITY, place.source_window), place).astype(np.uint32)
    known = np.isfinite(height - surface) & (np.bitwise_count(photographs) >= _SEEN)
    datum = np.median((height - surface)[known & np.isin(code, MEASURED) & np.isin(kind, _OPEN)])

    def off(found: np.ndarray) -> np.ndarray:
        away, below = np.abs(found - surface - datum), np.abs(found - ground - datum)
        return np.where(kind == _TREE, np.fmin(away, below), away)

    apart, both = np.abs(one.height - other.height), (one.height + other.height) / 2
    yield f"{run.name}: steps of {step:.3f} m at the finest level, {part.height} x {part.width} cells of {grid.cell:g} m."
    yield ""
    yield (
        "| code | class | cells | both sets within a step | 68 % of the errors of their mean below (m) |"
        " what their differences state (m) | off by more than 1 m | 68 % of the run's errors there (m) | it states (m) |"
        " farther apart: the run off by more than 1 m |"
    )
    yield "|" + " --- |" * 10
    for number, word in _CODES.items():
        for name, kinds in _CLASSES.items():
            here = known & (code == number) & np.isin(kind, kinds) & np.isfinite(apart)
            twice = here & (apart < step)
            if twice.sum() < _FEWEST:
                continue
            cells = word, name, f"{here.sum()}", f"{100 * twice.sum() / here.sum():.0f} %", f"{_within(off(both)[twice]):.2f}"
            ours = f"{1.4826 * np.median(apart[twice]) / 2:.2f}", f"{100 * (off(both)[twice] > _WRONG).mean():.1f} %"
            runs = f"{_within(off(height)[twice]):.2f}", f"{np.median(stated[twice]):.2f}"
            rest = off(height)[here & ~twice]
            yield "| " + " | ".join([*cells, *ours, *runs, f"{100 * (rest > _WRONG).mean():.1f} %" if rest.size else "-"]) + " |"


def _middle(shape: tuple[int, int]) -> Window:
    """Whole tiles of the volume in the middle of the grid."""
    rows, cols = (min(_TILES, size // SIDE) for size in shape)
    row, col = ((size // SIDE - tiles) // 2 for size, tiles in zip(shape, (rows, cols), strict=True))
    return Window(row * SIDE, col * SIDE, rows * SIDE, cols * SIDE)


def _within(off: np.ndarray) -> float:
    return float(np.quantile(off, 0.683))


def main(words: list[str]) -> None:
    """Write the page: of the finished run that is named, or of a new one."""
    about = (__doc__ or "").split("\n\n", 1)[1].replace("\n", " ").strip()
    with named_or_new_run(words, WORKFLOW) as run:
        write_page("found_twice", words, "\n".join(["# Estimates that were found twice", "", about, "", *rows(run), ""]))
