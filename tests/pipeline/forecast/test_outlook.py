import re
from pathlib import Path

from orthomill.pipeline.forecast.forecast import block_forecast
from orthomill.pipeline.forecast.outlook import effort_sentence, outlook
from orthomill.pipeline.forecast.rates import rates_of_release
from orthomill.schemas.findings.flight_findings import ExpectedFlight, FirstLook
from orthomill.schemas.photo import Header
from orthomill.tasks.catalogue import STAGES


def headers(count: int) -> tuple[Header, ...]:
    return tuple(Header(path=f"{i}.jpg", width=4000, height=3000, bands=3, dtype="uint8") for i in range(count))


def test_the_look_has_what_the_catalogue_expects_and_the_effort_of_a_run(tmp_path: Path):
    def seen(found, crs, beside):
        expected = ExpectedFlight(pattern=f"{len(found)} in {crs}")
        return FirstLook(findings=(), used=tuple(header.path for header in found), expected=expected)

    look = outlook(seen, STAGES, tmp_path)(headers(10), "EPSG:32634", None)
    pattern, effort = look.lines
    assert pattern == "10 in EPSG:32634"
    assert re.fullmatch(
        r"A run takes about \d+ min \(at most \d+ min\) on \d+ workers of up to [\d.]+ GB, and [\d.]+ GB of disk; by blocks "
        r"measured on another machine, for 120 megapixels\.",
        effort,
    )


def test_the_effort_grows_with_the_pixels():
    hours = effort_sentence(block_forecast(tuple(rates_of_release()), 1e5, 512, {}))
    assert re.search(r"about [\d.]+ h \(at most [\d.]+ h\)", hours) and "100000 megapixels" in hours
