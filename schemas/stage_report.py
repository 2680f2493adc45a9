"""What a stage reports: every stage writes one `StageReport` to `<stage>/report.json`.

It is declarative: the pipeline draws it without knowing what it means. Every figure is also in `summary.json` under
`<stage>.<name>`; names are stable and documented.
"""

from enum import StrEnum
from typing import Literal

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table

Accuracy = Literal["plan", "height"]
"""what of a product a class of accuracy is about"""


class _ReportPart(BaseModel):
    """Base of the parts of a report."""

    # Strict JSON would store NaN as null, which is not a float again when it is read: a curve may have gaps.
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")


class Topic(StrEnum):
    """What a client asks of a survey, in the words and the order of the report's first page."""

    PHOTOGRAPHS = "Photographs used"
    GROUND_PIXEL = "Pixel on the ground"
    AREA = "Area of the surface"
    HEIGHTS = "Heights"
    TERRAIN = "Bare ground"
    ORTHOIMAGE = "Orthoimage"
    ACCURACY_PLAN = "Accuracy in plan"
    ACCURACY_HEIGHT = "Accuracy in height"
    CHECK = "Photographs against the surface"
    PRECISION = "Precision of the block"
    REFERENCE = "Reference system"
    CAMERA = "Camera"
    CAMERA_RESIDUALS = "Residuals of the calibration"
    CAMERA_CHECK = "Calibration by halves"
    TIME = "Time"


WHERE_CHECKED = (Topic.CHECK,)
"""Told where a check answers it: a survey without one was not asked."""
OF_A_CAMERA = (Topic.CAMERA, Topic.CAMERA_RESIDUALS, Topic.CAMERA_CHECK)
"""Told where a calibration answers them; all others are what every survey is asked, once it has a place on the ground."""


class Answer(_ReportPart):
    """What a stage answers to one of these questions, in words; the answer of a later stage replaces that of an earlier one."""

    topic: Topic
    text: str


class Verdict(_ReportPart):
    """What a stage's results are worth, in one sentence.

    good: as it should be; fair: usable within the limits that the sentence names; poor: not to be used before it is mended.
    """

    level: Literal["good", "fair", "poor"]
    sentence: str
    weighs: bool = False
    """Whether it decides about what the user gets; otherwise it stands at its own stage only, unless it is poor."""


class Product(_ReportPart):
    """A file of the run's folder that the user takes away, and what it is for."""

    path: str
    purpose: str
    main: bool = False
    """One of the few that nearly everybody wants; the others are for other programs and closer analysis."""
    classed: tuple[Accuracy, ...] = ()
    """Of what in it a class of accuracy can be stated."""


class Evidence(_ReportPart):
    """What a stage knows of the accuracy of products: root mean square error in plan (radial) or in height, m, and its source."""

    of: Accuracy
    rmse: float
    source: str
    """as it follows a class: `from 30 check points`"""
    independent: bool = True
    """Whether it rests on something that took no part in making the product: agreement of a product with the photographs that it
    was made from may break a tolerance, but gives no class and proves none."""
    products: tuple[str, ...] = ()
    """Paths of the products that it is about; empty: all that have a class of this kind."""


class Figure(_ReportPart):
    """One number (or word) with its unit and meaning. `name` is snake_case and stable."""

    name: str
    label: str = ""
    """What people call it; made from the name where that says it already."""
    value: float | int | str | bool | None
    unit: str = ""
    sentence: str = ""
    headline: bool = False
    """One of the few figures of its stage that are read before the chapter is opened."""
    detail: bool = False
    """One of many figures for a closer analysis: collapsed in the report."""


class Grid(_ReportPart):
    """A table of rows for the report."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[float | int | str | None, ...], ...]
    note: str = ""


class Picture(_ReportPart):
    """A raster drawn at reduced resolution. `style` says how; `classes` gives colour and meaning of codes.

    hillshade: heights, shaded and tinted; rgb: colours as stored; ramp: `low` to `high` (percentiles 2 and 98 when None) in the
    colour map `colours`; diverging: symmetric about 0; classes: integer codes.
    """

    title: str
    raster: str
    style: Literal["hillshade", "rgb", "ramp", "diverging", "classes"]
    caption: str = ""
    unit: str = ""
    # Percentiles by default: a single blunder would otherwise stretch the colours until the rest looks uniform.
    low: float | None = None
    high: float | None = None
    colours: str = "viridis"
    classes: tuple[tuple[int, str, str], ...] = ()
    """(code, "#rrggbb", meaning)"""
    first_page: bool = False
    """Whether the report begins with it: a result that the run was made for."""


class Chart(_ReportPart):
    """A histogram, curves or points over x, vectors, or a map."""

    title: str
    style: Literal["bars", "lines", "points", "arrows", "map"]
    x_label: str
    y_label: str
    x: tuple[float, ...]
    series: dict[str, tuple[float, ...]]
    """bars, lines, points: name -> y. arrows: "y", "dx", "dy" (drawn exaggerated). map: "y" with labels in `labels`."""
    labels: tuple[str, ...] = ()
    caption: str = ""


class StageReport(_ReportPart):
    """Everything that one stage reports, in reading order."""

    verdict: Verdict | None = None
    answers: tuple[Answer, ...] = ()
    products: tuple[Product, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    """Of its own products and those of other stages."""
    aside: bool = False
    """Of a simulation, or of a comparison with a known truth: told after what a real survey would have."""
    figures: tuple[Figure, ...] = ()
    grids: tuple[Grid, ...] = ()
    charts: tuple[Chart, ...] = ()
    pictures: tuple[Picture, ...] = ()
    warnings: tuple[str, ...] = ()
    """Whole sentences: what is poorly determined or suspicious, where, and what to do."""
    doubts: tuple[str, ...] = ()
    """Those of the warnings that one must know before one believes any result of the project, the gravest first."""
    losses: tuple[str, ...] = ()
    """Those of the others that cost accuracy or ground, the dearest first; what remains is good to know."""
    lengths: str = ""
    """What lengths of this stage and of all after it are, where they are no metres on the ground."""


def report_table(stage: str) -> Table[StageReport]:
    """Where the report of `stage` is stored."""
    return Table(f"{stage}/report.json", StageReport)
