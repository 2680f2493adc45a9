"""Files of exposures without names of photographs: DJI's time marks (.MRK) and the events of RTKLIB and Emlid (_events.pos).

.MRK: `n  seconds-of-week  [week]  dN,N  dE,E  dV,V  latitude,Lat  longitude,Lon  height,Ellh  sN, sE, sV  code,Q`; latitude,
longitude and height are those of the sensor, the offset of the antenna (mm) is applied already (DJI, P4 RTK manual). .pos: comments
with %, then time, latitude, longitude, height, Q, satellites, sdn, sde, sdu (RTKLIB manual 2.4.2, appendix B.1), of the antenna.
"""

import math
import re
from datetime import UTC, datetime
from itertools import takewhile

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import HeightKind
from orthomill.schemas.survey_files.recognition import SOLUTION_LINE
from orthomill.schemas.survey_files.sniffed_table import lines_of
from orthomill.tasks.photos.position_files.listed_positions import ListedPosition, PositionList, Triple, fix_of

_NUMBER = r"([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)"
_IS_NUMBER = re.compile(_NUMBER)
_MRK = re.compile(
    rf"^\s*(\d+)\s+{_NUMBER}\s+\[\s*(\d+)\s*\].*?{_NUMBER}\s*,\s*Lat\s+{_NUMBER}\s*,\s*Lon\s+{_NUMBER}\s*,\s*Ellh"
    rf"(?:\s+{_NUMBER}\s*,\s*{_NUMBER}\s*,\s*{_NUMBER})?(?:\s+(\d+)\s*,\s*Q)?"
)
_WEEK = 604_800.0
_TRAJECTORY = 3
"""times as many lines as photographs, from which on a file is the path of the antenna and not its events"""


def is_mrk(text: str) -> bool:
    """Whether a text is DJI's list of time marks."""
    first = next((line for _, line in lines_of(text).others), "")
    return bool(_MRK.match(first))


def read_mrk(text: str) -> PositionList:
    """DJI's time marks: positions of the sensor, ellipsoidal heights."""
    found, mistakes = [], []
    for line, words in lines_of(text).others:
        match = _MRK.match(words)
        if match is None:
            mistakes.append(f"Line {line} of the time marks (.MRK) is incomplete: '{words.strip()[:60]}'; take it out.")
            continue
        number, seconds, week, lat, lon, height, sn, se, sv, code = match.groups()
        sigma = (float(se), float(sn), float(sv)) if sn else None
        time, fix = float(week) * _WEEK + float(seconds), fix_of(float(code)) if code else None
        place = (float(lon), float(lat), float(height))
        found.append(ListedPosition(line, "", place, sigma, fix=fix, number=int(number), time=time))
    return PositionList("DJI time marks (.MRK)", tuple(found), "EPSG:4979", "ellipsoidal", True, mistakes=tuple(mistakes))


def is_pos(text: str) -> bool:
    """Whether a text is a solution of RTKLIB or Emlid."""
    lines = lines_of(text)
    comments = " ".join(line for _, line in lines.comments if line.lstrip().startswith("%")).lower()
    named = "latitude" in comments or "x-ecef" in comments or "e-baseline" in comments
    # Some programs leave the comments out: a time, six numbers and more.
    return named or bool(lines.others and SOLUTION_LINE.match(lines.others[0][1]))


def read_pos(text: str) -> PositionList:
    """Events of RTKLIB and Emlid: positions of the antenna. Raises WorkflowError for solutions that are no places on the Earth."""
    lines = lines_of(text)
    head = " ".join(line for _, line in lines.comments).lower()
    if "e-baseline" in head:
        raise WorkflowError(
            "The positions file holds baselines from the base station (e-baseline), not positions; write it anew with latitude, "
            "longitude and height."
        )
    angles = 3 if "latitude(d'" in head or "latitude(dms" in head else 1
    found, mistakes = [], []
    for line, words in lines.others:
        one = _epoch(line, re.split(r"[\s,;]+", words.strip()), angles)
        if one is None:
            mistakes.append(f"Line {line} of the positions file (.pos) cannot be read: '{words.strip()[:60]}'.")
        else:
            found.append(one)
    geocentric = "x-ecef" in head
    heights: HeightKind = "sea_level" if "geodetic" in head else "ellipsoidal"
    return PositionList(
        "RTKLIB or Emlid solution (.pos)",
        tuple(found),
        "EPSG:4978" if geocentric else "EPSG:4326" if heights == "sea_level" else "EPSG:4979",
        heights,
        not geocentric,
        unit_stated=True,
        antenna=True,
        mistakes=tuple(mistakes),
    )


def _epoch(line: int, words: list[str], angles: int) -> ListedPosition | None:
    """One line of a solution: two words of time, two angles (of `angles` words each) and a height, Q, satellites, sigmas."""
    try:
        # Behind its numbers a line may name the device.
        time, numbers = _time(words[0], words[1]), [float(word) for word in takewhile(_IS_NUMBER.fullmatch, words[2:])]
        first, second = (_angle(numbers[i * angles : (i + 1) * angles]) for i in (0, 1))
        height, code, _, *rest = numbers[2 * angles :]
    except (ValueError, IndexError):
        return None
    # Latitude comes first, and with it the standard error to the north; geocentric coordinates have no such order.
    geocentric = abs(first) > 180.0 or abs(second) > 180.0
    place: Triple = (first, second, height) if geocentric else (second, first, height)
    sigma = (rest[0], rest[1], rest[2]) if len(rest) >= 3 else None
    if sigma:
        sigma = errors_on_the_ground(place, sigma) if geocentric else (sigma[1], sigma[0], sigma[2])
    return ListedPosition(line, "", place, sigma, fix=fix_of(code), time=time)


def errors_on_the_ground(place: Triple, sigma: Triple) -> Triple:
    """Standard errors to the east, to the north and upwards of geocentric ones at a geocentric place, whose correlations nobody
    states."""
    x, y, z = place
    longitude, latitude = math.atan2(y, x), math.atan2(z, math.hypot(x, y))
    east = (-math.sin(longitude), math.cos(longitude), 0.0)
    up = (math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude))
    north = (-math.sin(latitude) * math.cos(longitude), -math.sin(latitude) * math.sin(longitude), math.cos(latitude))
    own = [math.hypot(*(share * error for share, error in zip(axis, sigma, strict=True))) for axis in (east, north, up)]
    return own[0], own[1], own[2]


def _angle(parts: list[float]) -> float:
    value = sum(abs(part) / 60.0**power for power, part in enumerate(parts))
    return -value if str(parts[0]).startswith("-") else value


def _time(first: str, second: str) -> float:
    """Seconds of a time: `2023/05/17 08:15:02.345` or week and seconds of the week."""
    if "/" not in first and "-" not in first:
        return float(first) * _WEEK + float(second)
    day = datetime.strptime(first.replace("-", "/"), "%Y/%m/%d").replace(tzinfo=UTC)
    hours, minutes, seconds = second.split(":")
    return day.timestamp() + 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds)


def is_trajectory(events: int, photographs: int) -> bool:
    """Whether so many lines are the path of an antenna, and not its exposures."""
    return events > _TRAJECTORY * photographs + 20
