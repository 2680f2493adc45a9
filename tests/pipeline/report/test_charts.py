"""Charts as SVG: marks at the places that the values say, inside the drawing, whatever the values are."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.report.charts import MOST_MARKS, WIDTH, Frame, chart_svg, colour_bar_svg, thinned
from orthomill.pipeline.report.pictures import ColourBar
from orthomill.schemas.stage_report import Chart

VALUE = st.one_of(st.floats(-1e6, 1e6).filter(lambda value: value == 0 or abs(value) > 1e-9), st.just(float("nan")))


def chart(style: str, x, series, **more) -> Chart:
    return Chart(title="t", style=style, x_label="x", y_label="y", x=tuple(x), series=series, **more)


def drawn(*args, **more) -> ElementTree.Element:
    """The chart, parsed: well-formed markup is part of every test."""
    return ElementTree.fromstring(chart_svg(chart(*args, **more)))


def numbers(element: ElementTree.Element, *names: str) -> list[float]:
    return [float(part.get(name, "nan")) for part in element.iter() for name in names if part.get(name) is not None]


def marks(svg: ElementTree.Element, tag: str, kind: str = "fill") -> list[ElementTree.Element]:
    return [part for part in svg.iter(tag) if kind in part.get("class", "").split()]


@settings(max_examples=80, deadline=None)
@given(
    style=st.sampled_from(["bars", "lines", "points", "map"]),
    values=st.lists(st.tuples(VALUE, VALUE, VALUE), min_size=1, max_size=12),
)
def test_every_mark_is_finite_and_inside_the_drawing(style, values):
    x, one, other = zip(*values, strict=True)
    text = chart_svg(chart(style, sorted(x), {"a": one, "b": other}))
    assert "nan" not in text and "inf" not in text
    svg = ElementTree.fromstring(text)
    if svg.tag == "p":
        return
    high = float(svg.get("viewBox").split()[3])
    assert all(-0.5 <= value <= WIDTH + 0.5 for value in numbers(svg, "cx", "x1", "x2"))
    assert all(-0.5 <= value <= high + 0.5 for value in numbers(svg, "cy", "y1", "y2"))


@settings(max_examples=60, deadline=None)
@given(values=st.lists(st.integers(-100_000, 100_000).map(lambda n: n / 100), min_size=2, max_size=20, unique=True))
def test_heights_of_bars_are_proportional_to_their_values(values):
    bars = marks(drawn("bars", range(len(values)), {"a": values}), "rect")
    tall = np.array([float(bar.get("height")) for bar in bars])
    scale = np.max(tall) / np.max(np.abs(values))
    np.testing.assert_allclose(tall, scale * np.abs(values), atol=0.02)


def test_negative_bars_are_below_the_zero_line():
    up, down = marks(drawn("bars", (0, 1), {"a": (2.0, -1.0)}), "rect")
    zero = float(up.get("y")) + float(up.get("height"))
    assert float(down.get("y")) == pytest.approx(zero, abs=0.02)


def test_bars_of_two_series_are_next_to_each_other_under_a_legend():
    svg = drawn("bars", (0, 1), {"before": (1.0, 2.0), "after": (2.0, 1.0)})
    first, second = (
        sorted(float(bar.get("x")) for bar in marks(svg, "rect", f"s{n}") if bar.get("height") != "10") for n in (0, 1)
    )
    assert all(a < b for a, b in zip(first, second, strict=True))
    texts = [part.text for part in svg.iter("text")]
    assert "before" in texts and "after" in texts


def test_a_single_series_needs_no_legend():
    assert "only" not in [part.text for part in drawn("lines", (0, 1), {"only": (1.0, 2.0)}).iter("text")]


def test_categories_are_named_below_their_bars_and_long_names_are_slanted():
    names = ("photograph DJI_0030", "photograph DJI_0031", "a name that is far too long to be printed in full")
    svg = drawn("bars", (0, 1, 2), {"a": (1.0, 2.0, 3.0)}, labels=names)
    shown = [part for part in svg.iter("text") if (part.text or "").startswith(("photograph", "a name"))]
    assert len(shown) == 3 and all("rotate(-35" in part.get("transform", "") for part in shown)
    assert shown[2].text.endswith("…") and len(shown[2].text) == 26
    upright = drawn("bars", (0, 1), {"a": (1.0, 2.0)}, labels=("p", "q"))
    assert not [part for part in upright.iter("text") if "rotate(-35" in part.get("transform", "")]


def test_larger_values_are_drawn_higher_and_further_right():
    one, other = marks(drawn("points", (0.0, 1.0), {"a": (5.0, 7.0)}), "circle")
    assert float(one.get("cx")) < float(other.get("cx")) and float(one.get("cy")) > float(other.get("cy"))


def test_a_map_has_one_scale_for_both_axes():
    """A square of the ground is a square of the drawing, though the area is ten times as long as wide."""
    svg = drawn("map", (0.0, 10.0, 10.0, 1000.0), {"y": (0.0, 0.0, 10.0, 100.0)})
    a, b, c, _ = [(float(mark.get("cx")), float(mark.get("cy"))) for mark in marks(svg, "circle")]
    assert b[0] - a[0] == pytest.approx(b[1] - c[1], abs=0.11)


def test_names_on_a_map_are_left_out_when_there_are_too_many():
    few = drawn("map", range(60), {"y": tuple(range(60))}, labels=tuple(f"p{n}" for n in range(60)))
    many = drawn("map", range(61), {"y": tuple(range(61))}, labels=tuple(f"p{n}" for n in range(61)))
    assert len(marks(few, "text", "name")) == 60 and not marks(many, "text", "name")


@pytest.mark.parametrize(("dx", "dy"), [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.6, -0.8)])
def test_an_arrow_points_where_its_vector_points(dx, dy):
    """Up is positive y in the data and negative y on the screen."""
    text = chart_svg(chart("arrows", (0.0, 1.0), {"y": (0.0, 1.0), "dx": (dx, dx), "dy": (dy, dy)}))
    arrows = re.findall(r'class="arrow" d="M[-\d.]+,[-\d.]+ l(-?[\d.]+),(-?[\d.]+)', text)
    key, first, second = [(float(right), float(down)) for right, down in arrows]
    assert key[0] > 0 and key[1] == 0
    length = math.hypot(*first)
    assert first == second and first == pytest.approx((dx * length, -dy * length), abs=0.1)


def test_a_vector_without_a_value_is_not_drawn():
    nan = float("nan")
    text = chart_svg(chart("arrows", (0.0, 1.0, nan), {"y": (0.0, 1.0, 1.0), "dx": (1.0, nan, 1.0), "dy": (0.0, 0.0, 0.0)}))
    assert text.count("<circle") == 2, "the key and one vector"


@pytest.mark.parametrize(
    ("style", "is_thinned"), [("points", True), ("map", True), ("arrows", True), ("lines", False), ("bars", False)]
)
def test_only_marks_are_thinned(style, is_thinned):
    many = chart(style, map(float, range(MOST_MARKS + 1)), {"y": (1.0,)})
    assert thinned(many) is is_thinned and not thinned(many.model_copy(update={"x": many.x[:-1]}))


@pytest.mark.parametrize("series", [{"a": ()}, {"a": (float("nan"),)}])
def test_nothing_to_draw_is_a_sentence(series):
    assert "no values" in chart_svg(chart("lines", (1.0,), series))
    assert "no values" in chart_svg(chart("lines", (), {"a": (1.0,)}))


def test_a_frame_maps_its_corners_to_its_borders():
    frame = Frame(10.0, 20.0, -1.0, 1.0)
    assert frame.x(10.0) == frame.left and frame.x(20.0) == pytest.approx(WIDTH - 14)
    assert frame.y(-1.0) == frame.floor and frame.y(1.0) == pytest.approx(frame.top)


def test_a_colour_bar_shows_its_colours_its_histogram_and_round_ticks():
    svg = ElementTree.fromstring(colour_bar_svg(ColourBar(-1.0, 3.0, "m", ("#000000", "#ff0000", "#ffffff"), (1, 4, 2)), 7))
    stops = [(stop.get("offset"), stop.get("stop-color")) for stop in svg.iter("stop")]
    assert stops == [("0.0000", "#000000"), ("0.5000", "#ff0000"), ("1.0000", "#ffffff")]
    tall = [float(bar.get("height")) for bar in marks(svg, "rect", "counts")]
    assert tall[1] == 22 and tall == pytest.approx([5.5, 22, 11])
    assert [part.text for part in svg.iter("text")] == ["−1", "0", "1", "2", "3", "m"]
    assert next(svg.iter("linearGradient")).get("id") == "bar7"
