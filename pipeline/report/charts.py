"""Charts as inline SVG: bars, lines, points, arrows and maps, drawn from `orthomill.schemas.stage_report.Chart`.

Colours and fonts come from the page's style sheet (classes and CSS variables), so that one chart serves light mode, dark mode and
print. Coordinates have few decimals to keep the page small; a long series is thinned, and the caption says so.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

import numpy as np

from orthomill.pipeline.report.numbers import NARROW_SPACE, decimals_of, nice_step, number_text, tick_text, ticks
from orthomill.pipeline.report.pictures import ColourBar
from orthomill.schemas.stage_report import Chart

WIDTH, HEIGHT = 500, 290
RIGHT, TOP, BOTTOM = 14, 14, 46
ROW = 50
"""approximate distance of the ticks of the y axis, px"""
SERIES_COLOURS = 6
MOST_MARKS = 2500
"""More marks than this hide each other on 500 px, and every one costs about 60 bytes of the page."""
LEGEND_LEFT = 60.0
LETTER = 6.4
"""mean width of a letter, px; the text is laid out by the browser, so its width can only be estimated here"""


@dataclass(frozen=True)
class Frame:
    """The plotting area and the ranges of its axes."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float
    top: float = TOP
    height: float = HEIGHT
    bottom: float = BOTTOM

    @property
    def floor(self) -> float:
        """Where the x axis lies, px from the top."""
        return self.height - self.bottom

    @property
    def y_parts(self) -> int:
        """Into how many parts ticks divide the y axis."""
        return max(3, round((self.floor - self.top) / ROW))

    @property
    def left(self) -> float:
        """Left border of the plotting area, px: room for the label and the longest tick of the y axis."""
        return left_of(self.y_low, self.y_high, self.y_parts)

    def x(self, value: float) -> float:
        """Where a value of the x axis lies, px from the left."""
        return self.left + (value - self.x_low) / (self.x_high - self.x_low) * (WIDTH - self.left - RIGHT)

    def y(self, value: float) -> float:
        """Where a value of the y axis lies, px from the top."""
        return self.floor - (value - self.y_low) / (self.y_high - self.y_low) * (self.floor - self.top)


def left_of(low: float, high: float, parts: int) -> float:
    """Left border of the plotting area, px, such that the tick labels from `low` to `high` fit next to it."""
    step = nice_step(high - low, parts)
    return 32 + LETTER * max((len(tick_text(tick, step)) for tick in ticks(low, high, parts)), default=1)


def chart_svg(chart: Chart) -> str:
    """The chart as one <svg> element; a short sentence instead where there is no finite value."""
    if not any(np.isfinite(y).any() for y in chart.series.values() if len(y)) or not np.isfinite(chart.x).any():
        return '<p class="nothing">Nothing to draw: the chart has no values.</p>'
    return DRAWERS[chart.style](chart)


def _svg(height: float, body: list[str], title: str) -> str:
    return f'<svg class="chart" viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-label="{escape(title)}">{"".join(body)}</svg>'


def thinned(chart: Chart) -> bool:
    """Whether the chart shows only a part of its marks."""
    # Bars are few and curves are thinned below what can be seen, so nothing is said of them.
    return chart.style in ("points", "arrows", "map") and len(chart.x) > MOST_MARKS


# --- axes --------------------------------------------------------------------------------------------------------------------


def _padded(low: float, high: float, share: float = 0.04) -> tuple[float, float]:
    span = high - low
    # A single value gets an axis of a tenth of its size, so that the scale below is never divided by zero.
    if not span > 0:
        span = abs(low) * 0.1 or 1.0
        return low - span / 2, high + span / 2
    return low - share * span, high + share * span


def _range(values: np.ndarray) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)


def _text(x: float, y: float, text: str, kind: str = "", anchor: str = "middle", turn: float = 0.0) -> str:
    turned = f' transform="rotate({turn:g} {x:.1f} {y:.1f})"' if turn else ""
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{turned}>{escape(text)}</text>'


def _line(x1: float, y1: float, x2: float, y2: float, kind: str) -> str:
    return f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _y_axis(frame: Frame, label: str) -> Iterator[str]:
    step = nice_step(frame.y_high - frame.y_low, frame.y_parts)
    for tick in ticks(frame.y_low, frame.y_high, frame.y_parts):
        y = frame.y(tick)
        yield _line(frame.left, y, WIDTH - RIGHT, y, "axis" if tick == 0 else "rule")
        yield _text(frame.left - 7, y + 4, tick_text(tick, step), "tick", "end")
    yield _text(13, (frame.top + frame.floor) / 2, label, "label", turn=-90)


def _x_axis(frame: Frame, label: str, upright: bool = False) -> Iterator[str]:
    step = nice_step(frame.x_high - frame.x_low, 6)
    for tick in ticks(frame.x_low, frame.x_high, 6):
        x = frame.x(tick)
        top = frame.top if upright else frame.floor + 4
        yield _line(x, top, x, frame.floor, "rule" if upright and tick != 0 else "axis")
        yield _text(x, frame.floor + 18, tick_text(tick, step), "tick")
    yield _line(frame.left, frame.floor, WIDTH - RIGHT, frame.floor, "axis")
    yield _text((frame.left + WIDTH - RIGHT) / 2, frame.height - 8, label, "label")


def _legend(names: list[str], mark: str) -> tuple[list[str], float]:
    """Names with their colours in rows above the plot, and their height; nothing for a single series."""
    if len(names) < 2:
        return [], 0.0
    body, x, y = [], LEGEND_LEFT, 16.0
    for number, name in enumerate(names):
        width = 26 + LETTER * len(name)
        if x + width > WIDTH and x > LEGEND_LEFT:
            x, y = LEGEND_LEFT, y + 18
        body.append(f'<rect class="{mark} s{number % SERIES_COLOURS}" x="{x:.1f}" y="{y - 9:.1f}" width="12" height="10" rx="2"/>')
        body.append(_text(x + 17, y, name, "legend", "start"))
        x += width
    return body, y + 4


# --- bars, lines, points -----------------------------------------------------------------------------------------------------


def _bars(chart: Chart) -> str:
    x = _bar_places(chart)
    series = {name: np.asarray(y, float)[: len(x)] for name, y in chart.series.items()}
    legend, used = _legend(list(series), "fill")
    left, right, widest = _bar_span(x)
    low, top = _range(np.concatenate(list(series.values())))
    slanted = _slanted(chart)
    bottom = (BOTTOM if chart.x_label else BOTTOM - 18) + slanted
    frame = Frame(left, right, *_bar_heights(low, top), TOP + used, HEIGHT + used + slanted, bottom)
    axis = _category_axis(frame, chart, slanted > 0) if _categorical(chart) else _x_axis(frame, chart.x_label)
    body = [*legend, *_y_axis(frame, chart.y_label)]
    for number, y in enumerate(series.values()):
        body += _bar_marks(frame, x, y, (number, len(series), widest))
    return _svg(frame.height, [*body, *axis], chart.title)


def _bar_span(x: np.ndarray) -> tuple[float, float, float]:
    """Left and right border of all bars with centres `x`, and the width of one."""
    finite = x[np.isfinite(x)]
    places = np.unique(finite) if len(finite) else np.zeros(1)
    # Bars are as wide as the smallest step between them, so that unevenly spaced ones never overlap.
    widest = float(np.min(np.diff(places))) if len(places) > 1 else 1.0
    return float(places[0]) - widest / 2, float(places[-1]) + widest / 2, widest


def _bar_heights(low: float, top: float) -> tuple[float, float]:
    low, top = min(low, 0.0), max(top, 0.0)  # bars begin at zero: a truncated axis exaggerates differences
    span = (top - low) or 1.0
    return (low - 0.06 * span if low < 0 else 0.0), (top + 0.06 * span if top > 0 or low == 0 else 0.0)


def _categorical(chart: Chart) -> bool:
    return bool(chart.labels) and len(chart.labels) == len(chart.x)


def _bar_places(chart: Chart) -> np.ndarray:
    """Centres of the bars; if there is one x more than there are bars, x holds the edges of the bins."""
    if _categorical(chart):
        return np.arange(len(chart.x), dtype=float)
    x = np.asarray(chart.x, float)
    shortest = min(len(y) for y in chart.series.values())
    return (x[:-1] + x[1:]) / 2 if shortest == len(x) - 1 else x[:shortest]


def _bar_marks(frame: Frame, x: np.ndarray, y: np.ndarray, place: tuple[int, int, float]) -> Iterator[str]:
    number, count, widest = place
    wide = (frame.x(widest) - frame.x(0.0)) * (0.92 if count == 1 else 0.84)
    zero = frame.y(0.0)
    for middle, value in zip(x, y, strict=False):
        if math.isfinite(value) and math.isfinite(middle):
            left, end = frame.x(middle) - wide / 2 + number * wide / count, frame.y(value)
            yield (
                f'<rect class="fill s{number % SERIES_COLOURS}" x="{left:.2f}" y="{min(zero, end):.2f}" '
                f'width="{max(wide / count, 0.6):.2f}" height="{abs(end - zero):.2f}"/>'
            )


def _slanted(chart: Chart) -> float:
    """Room for slanted category names below the axis; 0 when they fit horizontally."""
    if not _categorical(chart):
        return 0.0
    longest = max(len(label) for label in chart.labels)
    room = (WIDTH - LEGEND_LEFT - RIGHT) / len(chart.labels)
    return 0.0 if longest * LETTER < room else min(longest, 26) * LETTER * 0.6


def _category_axis(frame: Frame, chart: Chart, slanted: bool) -> Iterator[str]:
    yield _line(frame.left, frame.floor, WIDTH - RIGHT, frame.floor, "axis")
    every = max(1, math.ceil(len(chart.labels) / 40))  # more than 40 slanted names on 500 px run into each other
    for place, label in list(enumerate(chart.labels))[::every]:
        shown = label if len(label) <= 26 else label[:25] + "…"
        yield _text(
            frame.x(place) + (4 if slanted else 0),
            frame.floor + (14 if slanted else 18),
            shown,
            "tick",
            "end" if slanted else "middle",
            -35 if slanted else 0,
        )
    yield _text((frame.left + WIDTH - RIGHT) / 2, frame.height - 8, chart.x_label, "label")


def _curves(chart: Chart) -> str:
    x = np.asarray(chart.x, float)
    series = {name: np.asarray(y, float) for name, y in chart.series.items()}
    marks = "fill" if chart.style == "points" else "swatch"
    legend, used = _legend(list(series), marks)
    frame = Frame(*_padded(*_range(x), 0.02), *_padded(*_range(np.concatenate(list(series.values())))), TOP + used, HEIGHT + used)
    body = [*legend, *_y_axis(frame, chart.y_label), *_x_axis(frame, chart.x_label)]
    for number, y in enumerate(series.values()):
        length = min(len(x), len(y))
        body += (_dots if chart.style == "points" else _polyline)(frame, x[:length], y[:length], number)
    return _svg(frame.height, body, chart.title)


def _polyline(frame: Frame, x: np.ndarray, y: np.ndarray, number: int) -> Iterator[str]:
    """A curve with gaps where values are missing; only every n-th value where there are far more values than pixels."""
    every = max(1, len(x) // MOST_MARKS)
    x, y = x[::every], y[::every]
    present = np.isfinite(x) & np.isfinite(y)
    for run in np.split(np.arange(len(x)), np.flatnonzero(np.diff(present)) + 1):
        if len(run) and present[run[0]]:
            path = " ".join(f"{frame.x(x[i]):.1f},{frame.y(y[i]):.1f}" for i in run)
            yield f'<polyline class="curve s{number % SERIES_COLOURS}" points="{path}"/>'
            # Dots show which values of a short series were computed; on a long one they would hide the curve.
            if len(run) <= 40:
                yield from _dots(frame, x[run], y[run], number)


def _dots(frame: Frame, x: np.ndarray, y: np.ndarray, number: int) -> Iterator[str]:
    every = max(1, math.ceil(len(x) / MOST_MARKS))
    radius = 2.6 if len(x) <= 400 else 1.6
    for place_x, place_y in zip(x[::every], y[::every], strict=True):
        if math.isfinite(place_x) and math.isfinite(place_y):
            place = f'cx="{frame.x(place_x):.1f}" cy="{frame.y(place_y):.1f}"'
            yield f'<circle class="fill s{number % SERIES_COLOURS}" {place} r="{radius}"/>'


# --- places in the plane -----------------------------------------------------------------------------------------------------


def _plane_frame(x: np.ndarray, y: np.ndarray, used: float) -> Frame:
    """Axes with equal scale; the height follows from the extent of the data, within limits."""
    (x_low, x_high), (y_low, y_high) = _padded(*_range(x), 0.08), _padded(*_range(y), 0.08)
    wide, room = WIDTH - left_of(y_low, y_high, 6) - RIGHT, 400.0
    scale = max((x_high - x_low) / wide, (y_high - y_low) / room)
    # A strip is far longer than wide: it keeps the same scale and gets empty margins instead of a distorted shape.
    tall = max((y_high - y_low) / scale, 150.0)
    grow_x, grow_y = (wide * scale - (x_high - x_low)) / 2, (tall * scale - (y_high - y_low)) / 2
    return Frame(x_low - grow_x, x_high + grow_x, y_low - grow_y, y_high + grow_y, TOP + used, TOP + used + tall + BOTTOM)


def _plane_axes(frame: Frame, chart: Chart) -> list[str]:
    return [*_y_axis(frame, chart.y_label), *_x_axis(frame, chart.x_label, upright=True)]


def _labels(frame: Frame, x: np.ndarray, y: np.ndarray, labels: tuple[str, ...]) -> Iterator[str]:
    """Names next to their points, if there are few enough to be legible."""
    if len(labels) <= 60:
        for place_x, place_y, label in zip(x, y, labels, strict=False):
            if math.isfinite(place_x) and math.isfinite(place_y):
                right = frame.x(place_x) + 7 + LETTER * len(label) < WIDTH
                side, anchor = (7, "start") if right else (-7, "end")
                yield _text(frame.x(place_x) + side, frame.y(place_y) - 5, label, "name", anchor)


def _map(chart: Chart) -> str:
    x = np.asarray(chart.x, float)
    series = {name: np.asarray(y, float) for name, y in chart.series.items()}
    legend, used = _legend(list(series), "fill")
    frame = _plane_frame(x, np.concatenate(list(series.values())), used)
    body = [*legend, *_plane_axes(frame, chart)]
    for number, y in enumerate(series.values()):
        length = min(len(x), len(y))
        body += _dots(frame, x[:length], y[:length], number)
        body += _labels(frame, x[:length], y[:length], chart.labels)
    return _svg(frame.height, body, chart.title)


def _arrows(chart: Chart) -> str:
    """Vectors at their places, all with the same exaggeration, and a key of round length."""
    x, y, dx, dy = (np.asarray(values, float) for values in (chart.x, chart.series["y"], chart.series["dx"], chart.series["dy"]))
    frame = _plane_frame(x, y, 22.0)
    lengths = np.hypot(dx, dy)
    finite = lengths[np.isfinite(lengths) & (lengths > 0)]
    # The 90th percentile sets the scale: the longest residual is often a blunder and would shrink all others to dots.
    usual = float(np.percentile(finite, 90)) if finite.size else 1.0
    every = max(1, math.ceil(len(x) / MOST_MARKS))
    # A usual vector takes about a tenth of the width, less where the points are dense.
    enlarged = min(0.1, 1.2 / math.sqrt(len(x) / every)) * (WIDTH - frame.left - RIGHT) / usual
    drawn = np.minimum(1.0, LONGEST_ARROW * usual / np.maximum(lengths, 1e-300)) * enlarged
    body = _plane_axes(frame, chart) + _arrow_key(usual, enlarged, int((finite > LONGEST_ARROW * usual).sum()))
    for index in range(0, len(x), every):
        kind = "arrow" if drawn[index] == enlarged else "arrow cut"
        body += _arrow(frame.x(x[index]), frame.y(y[index]), dx[index] * drawn[index], -dy[index] * drawn[index], kind)
    return _svg(frame.height, [*body, *_labels(frame, x, y, chart.labels)], chart.title)


LONGEST_ARROW = 2.0
"""Longer arrows, in units of the usual one, are drawn this long and in another colour: an outlier must not cross the page."""


def _arrow_key(usual: float, enlarged: float, cut: int) -> list[str]:
    key = nice_step(usual, 1)
    start = WIDTH - RIGHT - key * enlarged - 4
    text = f"scale of vectors:{NARROW_SPACE}{tick_text(key, key)}"
    note = f"{cut} longer than {number_text(LONGEST_ARROW * usual, decimals_of((usual,)))}: cut, red; " if cut else ""
    return [*_arrow(start, 14, key * enlarged, 0.0), _text(start - 8, 18, note + text, "legend", "end")]


def _arrow(x: float, y: float, dx: float, dy: float, kind: str = "arrow") -> Iterator[str]:
    """A shaft with a head, from (x, y) by (dx, dy), in the pixels of the drawing."""
    length = math.hypot(dx, dy)
    if not math.isfinite(x + y + length):
        return
    yield f'<circle class="fill s0" cx="{x:.1f}" cy="{y:.1f}" r="1.7"/>'
    if length >= 1:
        head = min(6.0, length * 0.45)
        back = (-head * dx / length, -head * dy / length)
        across = (-0.45 * back[1], 0.45 * back[0])
        yield (
            f'<path class="{kind}" d="M{x:.1f},{y:.1f} l{dx:.1f},{dy:.1f} m{back[0] + across[0]:.1f},{back[1] + across[1]:.1f} '
            f'L{x + dx:.1f},{y + dy:.1f} l{back[0] - across[0]:.1f},{back[1] - across[1]:.1f}"/>'
        )


DRAWERS = {"bars": _bars, "lines": _curves, "points": _curves, "arrows": _arrows, "map": _map}


# --- colour bars -------------------------------------------------------------------------------------------------------------


def colour_bar_svg(bar: ColourBar, number: int) -> str:
    """A colour bar with the histogram of the values above it; `number` makes its gradient's name unique in the page."""
    last = len(bar.colours) - 1
    stops = "".join(f'<stop offset="{place / last:.4f}" stop-color="{colour}"/>' for place, colour in enumerate(bar.colours))
    body = [
        f'<defs><linearGradient id="bar{number}">{stops}</linearGradient></defs>',
        *_bar_counts(bar),
        f'<rect fill="url(#bar{number})" x="{BAR_LEFT}" y="26" width="{BAR_WIDTH}" height="10"/>',
        *_bar_ticks(bar),
    ]
    unit = _text(BAR_LEFT + BAR_WIDTH + 8, 35, bar.unit, "tick", "start") if bar.unit else ""
    wide = BAR_WIDTH + 2 * BAR_LEFT + LETTER * len(bar.unit)
    size = f'viewBox="0 0 {wide:.0f} 58" style="width:{wide:.0f}px"'
    return f'<svg class="bar" {size} role="img" aria-label="colour bar">{"".join(body)}{unit}</svg>'


BAR_LEFT, BAR_WIDTH = 16, 308


def _bar_counts(bar: ColourBar) -> Iterator[str]:
    wide, most = BAR_WIDTH / len(bar.counts), max(*bar.counts, 1)
    for place, count in enumerate(bar.counts):
        tall = 22 * count / most
        yield f'<rect class="counts" x="{BAR_LEFT + wide * place:.2f}" y="{24 - tall:.2f}" width="{wide:.2f}" height="{tall:.2f}"/>'


def _bar_ticks(bar: ColourBar) -> Iterator[str]:
    """Round values below the bar."""
    step = nice_step(bar.high - bar.low, 5)
    for tick in ticks(bar.low, bar.high, 5):
        x = BAR_LEFT + BAR_WIDTH * (tick - bar.low) / (bar.high - bar.low)
        yield _line(x, 36, x, 40, "axis")
        yield _text(x, 53, tick_text(tick, step), "tick")
