"""Times of exposure: fractions of a second, zones, and one clock for all photographs of a receiver."""

import pytest

from orthomill.schemas.photo import Header, Photo
from orthomill.tasks.photos.tags.flights import with_flights
from orthomill.tasks.photos.tags.times import by_clock, by_utc, by_zone, with_one_clock

CLOCK = {"DateTimeOriginal": "2025:05:20 10:12:34", "SubSecTimeOriginal": "25"}
ZONE = {**CLOCK, "OffsetTimeOriginal": "+08:00"}
UTC = {**CLOCK, "drone-dji:UTCAtExposure": "2025-05-20T02:12:54.019996"}


def times(*tags: dict[str, str], serials: tuple[str, ...] = ()) -> list[str | None]:
    headers = tuple(Header(path=f"{i}.jpg", width=9, height=9, bands=3, dtype="uint8", tags=own) for i, own in enumerate(tags))
    facts = {"width": 9, "height": 9, "bands": 3, "dtype": "uint8", "camera": "c"}
    photos = [
        Photo(name=str(i), path=header.path, serial=serials[i] if serials else None, **facts) for i, header in enumerate(headers)
    ]
    return [photo.time for photo in with_one_clock(photos, headers)]


@pytest.mark.parametrize(
    ("tags", "time"),
    [
        ({"DateTimeOriginal": "2016:06:23 16:31:59"}, "2016-06-23T16:31:59"),
        ({"DateTime": "2016:06:23 16:31:59", "SubSecTime": "5"}, "2016-06-23T16:31:59.500"),
        ({"DateTimeOriginal": "2016:06:23 16:31:59.25"}, "2016-06-23T16:31:59.250"),
        ({"DateTime": "yesterday"}, None),
        ({"DateTimeOriginal": "0000:00:00 00:00:00"}, None),
        ({}, None),
        ({"DateTimeOriginal": "2020:01:01 00:00:00", "DateTime": "2024:05:05 00:00:00"}, "2020-01-01T00:00:00"),
        ({"DateTimeOriginal": "2020:01:01 00:00:00", "SubSecTime": "77"}, "2020-01-01T00:00:00"),
        ({"DateTimeOriginal": "2020:01:01 00:00:00", "SubSecTimeOriginal": "  "}, "2020-01-01T00:00:00"),
        ({"DateTimeOriginal": "2020:01:01 00:00:00", "SubSecTimeOriginal": "-1"}, "2020-01-01T00:00:00"),
        ({"DateTimeOriginal": "2020:01:01 00:00:00", "SubSecTimeOriginal": "037 "}, "2020-01-01T00:00:00.037"),
        (CLOCK, "2025-05-20T10:12:34.250"),
        (ZONE, "2025-05-20T02:12:34.250"),
        ({**CLOCK, "OffsetTimeOriginal": "-03:30"}, "2025-05-20T13:42:34.250"),
        (UTC, "2025-05-20T02:12:54.019996"),
        ({"drone-dji:UTCAtExposure": "2025:05:20 02:12:54.019996"}, "2025-05-20T02:12:54.019996"),
    ],
)
def test_times_are_iso_8601_to_the_fraction_that_is_told(tags, time):
    assert times(tags) == [time]


def test_one_photograph_without_the_better_clock_puts_all_on_the_other():
    assert times(UTC, CLOCK) == ["2025-05-20T10:12:34.250"] * 2
    assert times(ZONE, CLOCK) == ["2025-05-20T10:12:34.250"] * 2
    assert times(UTC, {}) == ["2025-05-20T02:12:54.019996", None], "one without any time is none of another clock"


def test_every_receiver_has_its_own_clock():
    assert times(UTC, CLOCK, serials=("A", "B")) == ["2025-05-20T02:12:54.019996", "2025-05-20T10:12:34.250"]


def test_tags_that_a_program_took_away_tear_no_flight_apart():
    headers = tuple(
        Header(path=f"{i}.jpg", width=9, height=9, bands=3, dtype="uint8", tags={**(UTC if i % 2 else CLOCK)}) for i in range(8)
    )
    facts = {"width": 9, "height": 9, "bands": 3, "dtype": "uint8", "camera": "c"}
    photos = [Photo(name=str(i), path=f"{i}.jpg", **facts) for i in range(8)]
    assert {photo.flight for photo in with_flights(with_one_clock(photos, headers))} == {0}


def test_the_three_clocks_differ_by_zone_and_setting():
    assert by_utc(CLOCK) is None and by_zone(CLOCK) is None
    assert (by_clock(ZONE) - by_zone(ZONE)).total_seconds() == 8 * 3600
    assert (by_utc(UTC) - by_zone({**UTC, **ZONE})).total_seconds() == pytest.approx(19.77, abs=0.01)
