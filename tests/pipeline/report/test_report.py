import base64
import math
import re
import struct
import zlib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from memory_store import MemoryStore

from orthomill.pipeline.engine.run_facts import Failure, RunFacts, StageRun
from orthomill.pipeline.painting.map_colours import exaggeration, shade
from orthomill.pipeline.painting.overview import overview
from orthomill.pipeline.report.charts import chart_svg
from orthomill.pipeline.report.numbers import column_texts, duration_text, number_text, ticks
from orthomill.pipeline.report.page import label_of, report_html, write_report
from orthomill.pipeline.report.pictures import draw
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport, Verdict, report_table

NAN = float("nan")
STYLES = ("hillshade", "rgb", "ramp", "diverging", "classes")
NASTY = '<script>alert("1 & 2")</script>'


def run_facts(**more):
    facts = {
        "project": "volos",
        "crs": "EPSG:2100",
        "version": "0.1.0",
        "started": "2026-11-21T10:00:00",
        "finished": "2026-11-21T10:05:00",
        "seconds": 300.0,
        "stages": (StageRun("a", 3, 2, 1, 0, 12.0),),
    }
    return RunFacts(**(facts | more))


def page(report, run=None, store=None):
    store = (store or MemoryStore()).put_table(report_table("a"), report)
    return report_html(store, (("a", "Stage A"),), run or run_facts(), Path())


def full_report():
    signed = Figure(name="check_rmse", value=0.1234, unit="m", sentence="How good it is.", headline=True)
    series = {"y": (1.0, NAN, 3.0), "dx": (0.1, 0.2, NAN), "dy": (0.0, 0.1, 0.2)}
    chart = Chart(title="c", style="bars", x_label="x", y_label="y", x=(1.0, 2.0, 3.0), labels=("a", "b", "c"), series=series)
    return StageReport(
        verdict=Verdict(level="good", sentence="s."),
        figures=(signed, Figure(name="photos", value=12)),
        grids=(Grid(title="Cameras", columns=("photo", "x"), rows=(("p1", 1.5), ("p2", None))),),
        charts=tuple(chart.model_copy(update={"style": style}) for style in ("bars", "lines", "points", "arrows", "map")),
        pictures=tuple(Picture(title=style, raster="a/r", style=style, classes=((1, "#ff0000", "one"),)) for style in STYLES),
        warnings=("One photograph did not join.",),
    )


class Sources(HTMLParser):
    """Everything of a page that a browser would fetch, and every element that has no business in it."""

    def __init__(self):
        super().__init__()
        self.fetched, self.elements = [], []

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        self.fetched += [value for name, value in attrs if name in ("src", "srcset", "data", "poster", "xlink:href")]
        self.fetched += [value for name, value in attrs if name == "href" and tag in ("link", "use", "image", "base")]


def store_with_raster():
    heights = np.linspace(-3, 7, 120 * 150).reshape(120, 150).astype(np.float32)
    heights[20:40] = np.nan
    return MemoryStore().put("a/r", heights, unit="m", nodata=NAN)


def test_the_page_asks_the_network_for_nothing():
    html = page(full_report(), store=store_with_raster())
    parser = Sources()
    parser.feed(html)
    assert len(parser.fetched) == 6 and all(source.startswith("data:") for source in parser.fetched)
    assert not {"iframe", "object", "embed", "base"} & set(parser.elements)
    assert "@import" not in html and not re.search(r"url\(\s*['\"]?(?!#)", html)
    assert "http://" not in html and "https://" not in html
    assert "default-src 'none'" in html


def test_everything_a_stage_declares_is_on_the_page():
    html = page(full_report(), store=store_with_raster())
    for text in ("Check RMSE", "0.123", "How good it is.", "Cameras", "p2", "1.5", "One photograph did not join.", "Stage A"):
        assert text in html
    # Five pictures, the first of them beside its chapter's verdict as well.
    assert html.count('<svg class="chart"') == 5 and html.count("<img") == 7
    assert html.count("data:image/") == 5, "every picture is in the page once"
    assert html.count('<svg class="bar"') == 3 and len(set(re.findall(r'id="(bar\d+)"', html))) == 3


def test_text_from_outside_is_never_markup():
    series = {NASTY: (1.0, 2.0), "b": (2.0, 3.0)}
    chart = Chart(
        title=NASTY, style="map", x_label=NASTY, y_label=NASTY, x=(1.0, 2.0), series=series, labels=(NASTY, "b"), caption=NASTY
    )
    bars = chart.model_copy(update={"style": "bars"})
    report = StageReport(
        figures=(Figure(name="n", value=NASTY, unit=NASTY, sentence=NASTY, headline=True),),
        charts=(chart, bars),
        warnings=(NASTY,),
        grids=(Grid(title=NASTY, columns=(NASTY,), rows=((NASTY,),), note=NASTY),),
        pictures=(
            Picture(title=NASTY, raster=NASTY, style="ramp", caption=NASTY),
            Picture(title=NASTY, raster="a/r", style="ramp", unit=NASTY),
            Picture(title=NASTY, raster="a/r", style="classes", classes=((0, "#000000", NASTY),)),
        ),
    )
    failures, machine = (Failure("a", NASTY, NASTY),), ((NASTY, NASTY),)
    run = run_facts(project=NASTY, workflow=NASTY, failures=failures, machine=machine, scheduler=NASTY)
    html = page(report, run, store_with_raster())
    assert "<script>alert" not in html
    assert html.count("&lt;script&gt;alert") >= 20


def test_an_unfinished_run_lists_what_has_not_begun():
    run = run_facts(
        finished=None,
        stages=(StageRun("a", 10, 3, 0, 1, 4.0), StageRun("b")),
        failures=(Failure("a", "a/tile/3/4", "The tile needed more memory than a worker may use."),),
    )
    store = MemoryStore().put_table(report_table("a"), full_report())
    html = report_html(store, (("a", "Stage A"), ("b", "Stage B")), run, Path())
    assert "Not complete: 1 job failed; 6 jobs are waiting; 1 stage has not begun." in html
    assert "This stage has not reported yet." in html and ">not yet<" in html
    assert "a/tile/3/4: The tile needed more memory than a worker may use." in html
    assert html.count("There is no raster a/r.") == 5


def test_a_complete_run_says_so():
    unjudged = full_report().model_copy(update={"verdict": None})
    assert "Complete: all 3 jobs of 1 stage are done, 1 of them unchanged since an earlier run; nothing says" in page(unjudged)


def test_without_marked_figures_the_first_one_stands_for_its_chapter():
    html = page(StageReport(figures=(Figure(name="first", value=1), Figure(name="second", value=2))))
    summary = html[html.index('<p class="signed">') : html.index("</summary>")]
    assert "First" in summary and "Second" not in summary


def test_a_chart_whose_series_do_not_fit_is_the_only_one_missing():
    chart = Chart(title="Residuals", style="arrows", x_label="", y_label="", x=(1.0,), series={"y": (1.0,)})
    assert "This chart cannot be drawn" in page(StageReport(charts=(chart,)))


def test_the_report_is_written_whole(tmp_path):
    write_report(MemoryStore(), (("a", "A"),), run_facts(), tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text().rstrip().endswith("</html>")
    assert len(list(tmp_path.iterdir())) == 1


# --- pictures ----------------------------------------------------------------------------------------------------------------


def test_an_overview_is_the_mean_of_what_has_a_value():
    """Blocks of 7 cut by chunks of 64: against plain NumPy, with holes and a rest at the border."""
    values = np.random.default_rng(0).normal(size=(200, 261)).astype(np.float32)
    values[values > 1] = np.nan
    values[:14, :14] = np.nan
    seen = overview(MemoryStore().put("r", values), "r", 38, nearest=False)
    assert seen.factor == 7 and seen.values.shape == (29, 38)
    for row, col in ((5, 9), (9, 10), (28, 37), (28, 0), (18, 36)):
        block = values[7 * row : 7 * row + 7, 7 * col : 7 * col + 7]
        assert seen.values[row, col] == pytest.approx(np.nanmean(block.astype(float)))
        assert seen.share[row, col] == pytest.approx(np.isfinite(block).mean())
    assert np.isnan(seen.values[0, 0]) and seen.share[0, 0] == 0


def test_an_overview_of_codes_takes_the_middle_pixel():
    codes = np.random.default_rng(0).integers(0, 5, (200, 261), np.uint8)
    seen = overview(MemoryStore().put("r", codes), "r", 38, nearest=True)
    rows, cols = np.minimum(np.arange(29) * 7 + 3, 199), np.minimum(np.arange(38) * 7 + 3, 260)
    np.testing.assert_array_equal(seen.values, codes[np.ix_(rows, cols)])


def test_a_picture_never_reads_more_than_a_chunk():
    store = MemoryStore().put("r", np.zeros((700, 500), np.float32), 128)
    draw(store, Picture(title="", raster="r", style="ramp"), limit=100)
    assert store.largest == 128 * 128


def palette_png(uri):
    """A palette PNG back as colours (rows, cols, 3)."""
    data = base64.b64decode(uri.partition(",")[2])
    cols, rows = struct.unpack(">II", data[16:24])
    parts, place = {}, 8
    while place < len(data):
        length, kind = struct.unpack(">I4s", data[place : place + 8])
        parts[kind] = data[place + 8 : place + 8 + length]
        assert zlib.crc32(kind + parts[kind]) == struct.unpack(">I", data[place + 8 + length : place + 12 + length])[0]
        place += 12 + length
    table = np.frombuffer(parts[b"PLTE"], np.uint8).reshape(-1, 3)
    return table[np.frombuffer(zlib.decompress(parts[b"IDAT"]), np.uint8).reshape(rows, cols + 1)[:, 1:]]


def test_classes_are_drawn_in_their_colours_with_their_shares():
    codes = np.repeat(np.array([[0, 1, 1, 9]], np.uint8), 20, axis=0).repeat(5, axis=1)
    classes = ((0, "#102030", "none"), (1, "#ff8000", "one"))
    drawing = draw(MemoryStore().put("r", codes), Picture(title="", raster="r", style="classes", classes=classes))
    colours = palette_png(drawing.uri)
    assert tuple(colours[0, 0]) == (0x10, 0x20, 0x30) and tuple(colours[3, 7]) == (0xFF, 0x80, 0)
    shares = [(entry.meaning, entry.share) for entry in drawing.classes]
    assert shares == [("none", 25), ("one", 50), ("code without explanation", 25)]


def test_diverging_colours_are_symmetric_about_zero():
    values = np.repeat(np.array([[-2.0, 0.0, 2.0, NAN]], np.float32), 8, axis=0)
    drawing = draw(MemoryStore().put("r", values), Picture(title="", raster="r", style="diverging", high=2.0))
    low, zero, high, _ = palette_png(drawing.uri)[4].astype(int)
    assert low[2] > low[0] and high[0] > high[2] and zero.min() > 240
    assert (drawing.bar.low, drawing.bar.high) == (-2, 2) and drawing.empty_share == 25


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("values", [np.full((30, 40), NAN), np.full((30, 40), 5.0), np.zeros((1, 1))])
def test_pictures_of_nothing_and_of_one_value_can_be_drawn(style, values):
    drawing = draw(MemoryStore().put("r", values.astype(np.float32), nodata=NAN), Picture(title="", raster="r", style=style))
    assert drawing.uri.startswith("data:image/") and (drawing.height, drawing.width) == values.shape


def test_an_unknown_colour_map_is_replaced():
    picture = Picture(title="", raster="a/r", style="ramp", colours="no_such_map")
    assert draw(store_with_raster(), picture).uri


def test_transparent_colours_count_as_no_value():
    colours = np.full((64, 64, 4), 255, np.uint8)
    colours[:16, :, 3] = 0
    drawing = draw(MemoryStore().put("r", colours), Picture(title="", raster="r", style="rgb"))
    assert drawing.empty_share == 25 and drawing.uri.startswith("data:image/jpeg")


def test_slopes_to_the_light_are_brighter():
    roof = np.minimum(np.arange(60.0), 60 - np.arange(60.0))[None].repeat(40, axis=0)
    bright = shade(roof, 1.0, exaggeration(roof, 1.0))
    assert bright[20, 15] > bright[20, 45] + 0.2


def test_scale_bar_and_corners_hold_for_the_ground():
    drawing = draw(store_with_raster(), Picture(title="", raster="a/r", style="ramp"))
    assert drawing.corners == ((409000.0, 4357000.0), (409075.0, 4356940.0))
    assert drawing.scale.per_cent == pytest.approx(100 * drawing.scale.metres / 75)


# --- charts and numbers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("style", ["bars", "lines", "points", "map"])
def test_charts_survive_single_and_missing_values(style):
    one = Chart(title="", style=style, x_label="", y_label="", x=(1.0,), series={"a": (2.0,)})
    assert "NaN" not in chart_svg(one) and "nan" not in chart_svg(one)
    none = one.model_copy(update={"series": {"a": (NAN,)}})
    assert "no values" in chart_svg(none)


def test_a_histogram_may_be_given_by_its_edges():
    svg = chart_svg(Chart(title="", style="bars", x_label="", y_label="", x=(0.0, 1.0, 2.0, 3.0), series={"a": (1.0, 2.0, 1.0)}))
    bars = re.findall(r'<rect[^>]* x="([\d.]+)"[^>]*width="([\d.]+)" height="([\d.]+)"', svg)
    left, wide, tall = np.array(bars, float).T
    assert len(bars) == 3 and np.all(wide > 0)
    assert tall[1] == pytest.approx(2 * tall[0], abs=0.02) and left[2] - left[1] == pytest.approx(left[1] - left[0], abs=0.02)


def test_curves_break_where_a_value_is_missing():
    chart = Chart(title="", style="lines", x_label="", y_label="", x=(0, 1, 2, 3, 4), series={"a": (1.0, 2.0, NAN, 2.0, 1.0)})
    assert chart_svg(chart).count("<polyline") == 2


def test_gaps_in_a_chart_survive_the_store(tmp_path):
    store, table = Store(tmp_path), report_table("a")
    chart = Chart(title="", style="lines", x_label="", y_label="", x=(0.0, 1.0, 2.0), series={"a": (1.0, NAN, 2.0)})
    store.write_table(table, StageReport(charts=(chart,), figures=(Figure(name="bias", value=NAN),)))
    back = store.table(table)
    assert math.isnan(back.charts[0].series["a"][1]) and "–" in report_html(store, (("a", "A"),), run_facts(), tmp_path)


def test_an_outlier_does_not_cross_the_page_and_is_counted():
    x, length = tuple(range(50)), (0.01,) * 49 + (50.0,)
    svg = chart_svg(Chart(title="t", style="arrows", x_label="", y_label="", x=x, series={"y": x, "dx": length, "dy": (0.0,) * 50}))
    assert svg.count('class="arrow cut"') == 1 and "1 longer than 0.02: cut, red; scale of vectors:" in svg
    steps = [abs(float(step)) for step in re.findall(r" l(-?[\d.]+),", svg)]
    assert 0 < max(steps) < 100


def test_details_are_collapsed_below_the_main_figures():
    details = [Figure(name=f"d{n}", value=n, detail=True) for n in range(30)]
    html = page(StageReport(figures=(Figure(name="main", value=1), *details)))
    shown, folded = html[html.index('<details class="chapter"') :].split('<details class="more"', 1)
    assert ">Main<" in shown and ">D7<" not in shown and "30 more figures" in folded and ">D7<" in folded


def test_a_unit_is_next_to_the_value_and_not_in_the_label_too():
    html = page(StageReport(figures=(Figure(name="sigma0_px", value=0.5, unit="px"), Figure(name="px", value=2.0, unit="px"))))
    assert ">Sigma0<" in html and ">Px<" in html


def test_many_points_are_thinned_and_the_caption_says_so():
    x = tuple(map(float, range(20000)))
    chart = Chart(title="", style="points", x_label="", y_label="", x=x, series={"a": (1.0, 2.0) * 10000})
    assert chart_svg(chart).count("<circle") <= 2500
    assert "Only some of the marks are drawn." in page(StageReport(charts=(chart,)))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (NAN, "–"),
        (math.inf, "∞"),
        (True, "yes"),
        ("word", "word"),
        (2100, "2100"),
        (1234567, "1 234 567"),
        (0.0, "0"),
        (0.28712, "0.287"),
        (-12.345, "−12.35"),
        (409123.4567, "409 123.457"),
        (-1.5e-9, "−1.500 · 10⁻⁹"),
        (0.01234, "0.0123"),
        (-0.0, "0"),
    ],
)
def test_numbers_are_printed_with_significant_digits(value, text):
    assert number_text(value).replace("\u202f", " ") == text


def test_a_column_has_one_number_of_decimals():
    assert column_texts((1.5, 2.25, -0.12345, None)) == ["1.500", "2.250", "−0.123", "–"]


def test_ticks_are_round_and_inside():
    assert ticks(-3.2, 7.7, 5) == [-2.0, 0.0, 2.0, 4.0, 6.0]
    assert duration_text(185).replace("\u202f", " ") == "3 min 05 s"


def test_labels_come_from_names():
    assert label_of("check_rmse_plan") == "Check RMSE plan" and label_of("dsm_nmad") == "DSM NMAD"
