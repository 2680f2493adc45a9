"""The picture of the README from a finished run: `python -m benchmarks readme_picture runs/brighton docs/pictures/brighton.jpg`.

Orthoimage, surface, origin of the heights and check side by side, drawn by the report's own painters, each with its caption and its
legend. Pale is what has no value. All four show the same ground: what the orthoimage covers.
"""

import base64
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from orthomill.pipeline.painting.overview import overview
from orthomill.pipeline.report.pictures import HATCH, ClassEntry, ColourBar, Drawing, draw
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.stage_report import Picture, StageReport, report_table

SIDE = 1000
"""longest side of a drawing before it is cut to the ground that is shown, px"""
WIDTH, GAP = 12.0, 0.3
ABOVE, BAR, LINE = 0.6, 0.6, 0.185
"""width of the sheet and between panels; heights of the texts above one, of a bar of colours and of a line of a legend; inches of
100 px"""
NOTHING = "#000000"
"""the colour of the class that has no value"""
SEEN = 0.5
"""% of the ground: classes with less are not in a legend"""


@dataclass(frozen=True)
class Panel:
    """A raster and what is said of it."""

    raster: str
    title: str
    caption: str


PANELS = (
    Panel("texture/ortho", "True orthoimage", "Every cell from photographs that see it; pale where none does"),
    Panel("densification/height", "Surface model", "Heights (m), shaded; trees and roofs included"),
    Panel("densification/provenance", "How each height was obtained", "A code for every cell, beside its standard error"),
    Panel("dsm_check/dh", "Check without reference data", "Correction (m) that the photographs demand; pale where not judged"),
)


def picture_of(store: Store, raster: str) -> Picture:
    """The picture of a raster as its stage shows it in the report."""
    report: StageReport = store.table(report_table(raster.split("/")[0]))
    return next(picture for picture in report.pictures if picture.raster == raster)


def pixels(drawing: Drawing) -> np.ndarray:
    """uint8 (rows, cols, 3) RGB of a drawing; classes without a value are pale as everything else without one."""
    encoded = np.frombuffer(base64.b64decode(drawing.uri.split(",")[1]), np.uint8)
    image = cv2.cvtColor(cv2.imdecode(encoded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    if drawing.classes:
        image[(image == 0).all(2)] = HATCH[0]
    return image


def covered(store: Store) -> tuple[slice, slice]:
    """Rows and columns of a drawing between which the orthoimage has colours."""
    share = overview(store, "texture/ortho", SIDE, nearest=False).share > 0
    rows, cols = np.flatnonzero(share.any(1)), np.flatnonzero(share.any(0))
    return slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)


def explain(axes: Axes, drawing: Drawing) -> None:
    """The legend below a panel: a bar of colours, or the classes that occur, most frequent first."""
    if drawing.bar:
        _colour_bar(axes, drawing.bar)
    elif drawing.classes:
        _classes(axes, drawing.classes)


def _colour_bar(axes: Axes, bar: ColourBar) -> None:
    colours = ScalarMappable(Normalize(bar.low, bar.high), LinearSegmentedColormap.from_list("bar", bar.colours))
    place = axes.inset_axes((0, -0.05, 0.6, 0.025))
    axes.figure.colorbar(colours, cax=place, orientation="horizontal").ax.tick_params(labelsize=9)


def shown(classes: tuple[ClassEntry, ...]) -> list[ClassEntry]:
    """The classes of a legend."""
    return sorted((entry for entry in classes if entry.share >= SEEN and entry.colour != NOTHING), key=lambda entry: -entry.share)


def _classes(axes: Axes, classes: tuple[ClassEntry, ...]) -> None:
    handles = [Patch(color=entry.colour, label=entry.meaning) for entry in shown(classes)]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0, 0), frameon=False, fontsize=9, borderaxespad=0.2, borderpad=0)


def sheet(store: Store) -> Figure:
    """Four panels, two beside each other."""
    rows, cols = covered(store)
    width = (WIDTH - GAP) / 2
    height = width * (rows.stop - rows.start) / (cols.stop - cols.start)
    drawings = [draw(store, picture_of(store, panel.raster), SIDE) for panel in PANELS]
    below = max(BAR, *(LINE * (len(shown(drawing.classes)) + 1) for drawing in drawings))
    total = 2 * (height + ABOVE + below)
    figure = Figure((WIDTH, total), dpi=100, facecolor="white")
    for number, (panel, drawing) in enumerate(zip(PANELS, drawings, strict=True)):
        left, bottom = number % 2 * (width + GAP), total / 2 * (1 - number // 2) + below
        axes = figure.add_axes((left / WIDTH, bottom / total, width / WIDTH, height / total))
        axes.imshow(pixels(drawing)[rows, cols], interpolation="lanczos")
        axes.set_axis_off()
        axes.annotate(panel.title, (0, 1), (2, 23), "axes fraction", "offset points", fontsize=13, weight="bold")
        axes.annotate(panel.caption, (0, 1), (2, 7), "axes fraction", "offset points", fontsize=10, color="#444444")
        explain(axes, drawing)
    return figure


def main(words: list[str]) -> None:
    """Draw and write."""
    target = Path(words[1])
    target.parent.mkdir(parents=True, exist_ok=True)
    sheet(Store(Path(words[0]))).savefig(target, pil_kwargs={"optimize": True, "quality": 88})
