"""The report: one self-contained HTML page, generated from what every stage declares, without knowing what it means.

It answers first (`first_page.py`), and what stages declare folds below, a chapter each.

Everything variable is text that the template escapes; the only markup passed in are the charts, which escape their own text. The
page loads nothing from the network: its pictures are data URIs, and a content security policy makes the browser enforce this.
"""

from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, StageTitle
from orthomill.pipeline.report import numbers
from orthomill.pipeline.report.accepted_part import accepted_part
from orthomill.pipeline.report.charts import chart_svg, colour_bar_svg, thinned
from orthomill.pipeline.report.first_page import Caution, FirstPage, Reports, first_page, not_asked_for
from orthomill.pipeline.report.page_template import page_template
from orthomill.pipeline.report.pictures import Drawing, draw
from orthomill.pipeline.report.present_reports import present_reports
from orthomill.pipeline.report.signed_page import signed_part
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import StoreError
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport

LEADING = 2
"""pictures beside each other at the top"""


@dataclass(frozen=True)
class FigureRow:
    """A figure as it is printed."""

    stage: str
    name: str
    label: str
    value: str
    unit: str
    sentence: str
    detail: bool


@dataclass(frozen=True)
class PictureView:
    """A picture with its legend, or the sentence that says why it is missing."""

    name: str
    """under which other places of the page show the same picture"""
    picture: Picture
    drawing: Drawing | None
    bar: Markup | None = None
    missing: str = ""


@dataclass(frozen=True)
class ChartView:
    """A chart, drawn, and its caption."""

    title: str
    svg: Markup
    caption: str


_SENTENCE = 80
"""letters of a cell from which on it needs room for a line, on a telephone as well"""


@dataclass(frozen=True)
class GridView:
    """A table with its cells as text; `numeric` says which columns are right-aligned, `long` which hold sentences."""

    grid: Grid
    numeric: tuple[bool, ...]
    long: tuple[bool, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Section:
    """One stage of the page."""

    kind: str
    title: str
    state: str
    """done, failed, unfinished, not yet or not run"""
    run: StageRun
    report: StageReport
    figures: tuple[FigureRow, ...]
    pictures: tuple[PictureView, ...]
    charts: tuple[ChartView, ...]
    grids: tuple[GridView, ...]
    failures: tuple[str, ...]
    cautions: tuple[Caution, ...]

    @property
    def main_figures(self) -> tuple[FigureRow, ...]:
        """The figures that are read before the chapter is opened."""
        marked = [row for row, figure in zip(self.figures, self.report.figures, strict=True) if figure.headline]
        return tuple(marked) or self.figures[:1]


def write_report(store: ReadableStore, stages: tuple[StageTitle, ...], run: RunFacts, path: Path) -> None:
    """Write the page for a run, finished or not, completely or not at all. Raises StoreError when the disk refuses."""
    write_whole(path, report_html(store, stages, run, path.parent).encode())


def report_html(store: ReadableStore, stages: tuple[StageTitle, ...], run: RunFacts, folder: Path) -> str:
    """The page as text; `stages` are all of the workflow, and those without a report are listed as such."""
    bars = _Counter()
    reports = present_reports(store, stages, run)
    answers = first_page(reports, stages, run, folder)
    sections = tuple(_section(store, stage, run, reports, answers, bars) for stage in stages)
    # What is simulated, or compared with a known truth, comes after what a real survey would have.
    sections = tuple(sorted(sections, key=lambda section: section.report.aside))
    return page_template("report.html").render(
        run=run,
        first=answers,
        sections=sections,
        leading=leading(sections),
        not_run=not_asked_for(stages, run),
        longest=max((section.run.seconds for section in sections), default=0.0) or 1.0,
        failed=[section for section in sections if section.failures],
        signed=signed_part(folder),
        accepted=accepted_part(folder),
    )


def leading(sections: tuple[Section, ...]) -> tuple[PictureView, ...]:
    """The pictures at the top: results as marked, those of the last stage first, in its order; before there are any, what the last
    stages show."""
    latest_first = tuple(reversed(sections))
    marked = [view for section in latest_first for view in section.pictures if view.drawing and view.picture.first_page]
    firsts = [section.pictures[0] for section in latest_first if section.pictures and section.pictures[0].drawing]
    return tuple((marked or firsts)[:LEADING])


class _Counter:
    """Numbers the colour bars of a page, because the ids of SVG gradients are shared by the whole page."""

    def __init__(self) -> None:
        self.last = 0

    def next(self) -> int:
        self.last += 1
        return self.last


# --- one stage ---------------------------------------------------------------------------------------------------------------


def _section(
    store: ReadableStore, stage: StageTitle, run: RunFacts, reports: Reports, answers: FirstPage, bars: _Counter
) -> Section:
    kind, title = stage
    report = reports.get(kind, StageReport())
    return Section(
        kind=kind,
        title=title,
        state="not run" if title in not_asked_for((stage,), run) else _state(run.stage(kind), kind in reports),
        run=run.stage(kind),
        report=report,
        figures=tuple(figure_row(kind, figure) for figure in report.figures),
        pictures=tuple(_picture_view(store, f"{kind}-{n}", picture, bars) for n, picture in enumerate(report.pictures)),
        charts=tuple(_chart_view(chart) for chart in report.charts),
        grids=tuple(_grid_view(grid) for grid in report.grids),
        failures=tuple(f"{failure.key}: {failure.sentence}" for failure in run.failures if failure.stage == kind),
        cautions=tuple(caution for caution in answers.cautions if caution.kind == kind),
    )


def _state(run: StageRun, reported: bool) -> str:
    if run.failed:
        return "failed"
    if reported and not run.waiting:
        return "done"
    return "unfinished" if reported or run.done or run.skipped else "not yet"


CAPITALS = frozenset(
    ["crs", "sd", "rmse", "nmad", "rms", "psnr", "ssim", "dsm", "dem", "gsd", "gnss", "gps", "exif", "lsm", "cpu", "nva", "vva"]
)
"""Abbreviations that are capitalised in a label made from a name."""


def label_of(name: str) -> str:
    """A label from a stable name: `check_rmse_plan` becomes "Check RMSE plan"."""
    words = [word.upper() if word in CAPITALS else word for word in name.split("_") if word]
    label = " ".join(words)
    return label[:1].upper() + label[1:]


def figure_row(kind: str, figure: Figure) -> FigureRow:
    """A figure as text."""
    value = numbers.number_text(figure.value)
    name, unit = figure.name, figure.unit
    return FigureRow(
        stage=kind,
        name=f"{kind}.{name}",
        label=figure.label or label_of(_without_unit(name, unit)),
        value=value,
        unit=unit,
        sentence=figure.sentence,
        detail=figure.detail,
    )


def _without_unit(name: str, unit: str) -> str:
    """`sigma0_px` in px is labelled `sigma0`: the unit is printed next to the value."""
    suffix = {"micrometres": "_um", "degrees": "_deg"}.get(unit, f"_{unit}")
    return name.removesuffix(suffix) or name


def _picture_view(store: ReadableStore, name: str, picture: Picture, bars: _Counter) -> PictureView:
    try:
        drawing = draw(store, picture)
    except StoreError as error:
        return PictureView(name, picture, None, missing=str(error))
    return PictureView(name, picture, drawing, Markup(colour_bar_svg(drawing.bar, bars.next())) if drawing.bar else None)


def _chart_view(chart: Chart) -> ChartView:
    """A chart as markup; one whose series do not fit its style is replaced by a sentence."""
    # One wrong chart must not cost the whole report at the end of a run of hours.
    try:
        svg = Markup(chart_svg(chart))
    except (KeyError, ValueError) as error:
        svg = Markup('<p class="nothing">This chart cannot be drawn: {}.</p>').format(str(error))
    note = " Only some of the marks are drawn." if thinned(chart) else ""
    return ChartView(chart.title, svg, chart.caption + note)


def _grid_view(grid: Grid) -> GridView:
    # Rows may be shorter than the header: later columns are absent where a method did not get that far.
    columns = [tuple(row[place] if place < len(row) else None for row in grid.rows) for place in range(len(grid.columns))]
    texts = [numbers.column_texts(column) for column in columns]
    numeric = tuple(numbers.is_numeric(column) for column in columns)
    long = tuple(any(len(text) > _SENTENCE for text in column) for column in texts)
    return GridView(grid, numeric, long, tuple(zip(*texts, strict=True)))
