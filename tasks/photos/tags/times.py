"""When photographs were taken, to the fraction of a second that their tags give, by one clock for all of a receiver.

A drone at 15 m/s with an exposure every 0.7 s has two or three photographs in the same second of its tags: their order, the speed
between them and the breaks between flights need the fraction. Three clocks, the best first: the moment of exposure in UTC that DJI
writes to the microsecond; the camera's clock with its offset from UTC; the camera's clock. One that not all photographs of a
receiver have (a program took the others' tags away) would tear its flights apart by the hours between two time zones.

Sources: EXIF 2.31 (DateTimeOriginal, SubSecTimeOriginal, OffsetTimeOriginal); DJI, Mavic 3M and Matrice 4 manuals (UTCAtExposure).
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from datetime import datetime, timedelta

from orthomill.schemas.photo import Header, Photo, tag_text
from orthomill.tasks.photos.tags.makers import maker_text

_MOMENT = re.compile(r"(\d{4})[:-](\d\d)[:-](\d\d)[ T](\d\d):(\d\d):(\d\d)(?:\.(\d{1,9}))?\b.*", re.DOTALL)
_OFFSET = re.compile(r"([+-])(\d\d):(\d\d)")


def by_utc(tags: Mapping[str, str]) -> datetime | None:
    """The moment of exposure in UTC that the maker wrote."""
    return _moment(maker_text(tags, "UTCAtExposure"), "")


def by_clock(tags: Mapping[str, str]) -> datetime | None:
    """What the camera's clock showed, in whatever zone it was set to."""
    if original := tag_text(tags, "DateTimeOriginal"):
        # GDAL has a name of its own for it.
        return _moment(original, tag_text(tags, "SubSecTimeOriginal") or tag_text(tags, "SubSecTime_Original"))
    return _moment(tag_text(tags, "DateTime"), tag_text(tags, "SubSecTime"))


def by_zone(tags: Mapping[str, str]) -> datetime | None:
    """The camera's clock in UTC, where the tags tell its zone."""
    clock, offset = by_clock(tags), _OFFSET.fullmatch(tag_text(tags, "OffsetTimeOriginal"))
    if clock is None or offset is None:
        return None
    east = timedelta(hours=int(offset[2]), minutes=int(offset[3]))
    return clock - east if offset[1] == "+" else clock + east


_CLOCKS = (by_utc, by_zone, by_clock)


def with_one_clock(photos: list[Photo], headers: tuple[Header, ...]) -> list[Photo]:
    """The photographs with the times by the best clock that all of their receiver have that have any."""
    tags = {header.path: header.tags for header in headers}
    receivers: defaultdict[str, list[Photo]] = defaultdict(list)
    for photo in photos:
        receivers[photo.serial or ""].append(photo)
    times: dict[str, str | None] = {}
    for own in receivers.values():
        timed = [tags[photo.path] for photo in own if by_clock(tags[photo.path]) or by_utc(tags[photo.path])]
        clock = next((clock for clock in _CLOCKS if all(map(clock, timed))), by_clock)
        times |= {photo.path: _iso(clock(tags[photo.path])) for photo in own}
    return [photo.model_copy(update={"time": times[photo.path]}) for photo in photos]


def _iso(moment: datetime | None) -> str | None:
    """ISO 8601 with as many digits of the second as are told: none, three or six."""
    if moment is None:
        return None
    digits = "seconds" if not moment.microsecond else "milliseconds" if moment.microsecond % 1000 == 0 else "microseconds"
    return moment.isoformat(timespec=digits)


def _moment(text: str, fraction: str) -> datetime | None:
    """A time of EXIF or XMP, with the digits of its fraction from a tag of their own where the text has none."""
    match = _MOMENT.fullmatch(text)
    if match is None:
        return None
    digits = match[7] or fraction.strip()
    micro = int(digits[:6].ljust(6, "0")) if re.fullmatch(r"\d{1,9}", digits, re.ASCII) else 0
    try:
        return datetime.fromisoformat("{}-{}-{}T{}:{}:{}".format(*match.groups()[:6])).replace(microsecond=micro)
    except ValueError:  # months of zero
        return None
