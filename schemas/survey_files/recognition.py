"""Which files hold positions of photographs or control, by their first lines: what lies beside photographs is used or named.

Only the head of a file decides here; its reader judges every line. Formats are described where they are read.
"""

import math
import re
from dataclasses import dataclass

from orthomill.schemas.maps.system_names import known_crs
from orthomill.schemas.survey_files.column_words import columns
from orthomill.schemas.survey_files.photograph_names import EXTENSIONS, PhotographNames, is_image_word
from orthomill.schemas.survey_files.sniffed_table import Separation, lines_of, separation

NAMED_IMAGE = re.compile(rf"^\s*(.*?\.(?:{'|'.join(sorted(EXTENSIONS))}))(?=[\s,;]|$)[\s,;]*(.*)$", re.IGNORECASE)
"""the name of an image file, which may hold blanks, and what follows it"""
_MARK = re.compile(r"([-+]?\d+\.\d+)\s*,\s*Lat\s+([-+]?\d+\.\d+)\s*,\s*Lon\s+[-+]?[\d.]+\s*,\s*Ellh")
_CODE = re.compile(r"EPSG:{1,2}(\d{4,6})", re.IGNORECASE)
_SYSTEMS = ("EPSG:", "+PROJ", "WGS84", "WGS 84", "PROJCS[", "PROJCRS[", "GEOGCS[", "COMPD_CS[", "ETRS89", "NAD83")
_LEAST_NAMED = 0.5
"""of the photographs that a file must name to be theirs"""


@dataclass(frozen=True)
class FoundPositions:
    """A positions file: its format, how many lines it has, how many photographs it names (None: it has no names), the reference
    system that it states, and longitude and latitude of its first line, where they are degrees."""

    format: str
    lines: int
    named: int | None
    system: str | None = None
    site: tuple[float, float] | None = None

    def fits(self, photographs: int) -> bool:
        """Whether it is about so many photographs."""
        if self.named is None:
            return self.lines == photographs
        return self.named > 0 and self.named >= _LEAST_NAMED * photographs

    def misfit(self, photographs: int) -> str:
        """Why it is not used, as the end of a sentence."""
        if self.named is None:
            return f"has {self.lines} exposures without names for {photographs} photographs"
        return f"names {self.named} of the {photographs} photographs"


@dataclass(frozen=True)
class FoundControl:
    """A file of control: its format, what it holds, the points that it names, and the reference system that it states."""

    format: str
    holds: str
    """all, points or marks"""
    names: frozenset[str] = frozenset()
    system: str | None = None


def looks_like_system(line: str) -> bool:
    """Whether a line can be the name of a reference system: EPSG:4326, WGS84 UTM 16N, a PROJ string, WKT."""
    own = line.strip().upper()
    return own.startswith(_SYSTEMS) or known_crs(line) is not None


def positions_in(text: str, names: PhotographNames) -> FoundPositions | None:
    """What a text holds of positions; None where it holds none."""
    lines = lines_of(text, ("#", "%"))
    data = [line for _, line in lines.others]
    if not data:
        return None
    if mark := _MARK.search(data[0]):
        return FoundPositions("DJI time marks (.MRK)", len(data), None, "EPSG:4979", (float(mark[2]), float(mark[1])))
    comments = " ".join(line for _, line in lines.comments)
    if "%" in comments and ("latitude(deg)" in comments.lower() or "x-ecef" in comments.lower()):
        return FoundPositions("RTKLIB or Emlid solution (.pos)", len(data), None, "EPSG:4979", _site(data[0].split()[2:4], True))
    first = NAMED_IMAGE.match(data[1]) if len(data) > 1 and looks_like_system(data[0]) else None
    if first and _numeric(tuple(first[2].split()[:2]), separation([first[2]])):
        found = [match[1] for line in data[1:] if (match := NAMED_IMAGE.match(line))]
        site = _site(first[2].split()[:2], False) if "4326" in data[0] else None
        return FoundPositions("geo.txt of OpenDroneMap", len(found), _count(found, names), data[0].strip(), site)
    return _table_of_positions([line for _, line in lines.comments], data, names)


def _table_of_positions(comments: list[str], data: list[str], names: PhotographNames) -> FoundPositions | None:
    for head, body in [(data[0], data[1:]), *((line.lstrip("# "), data) for line in reversed(comments))]:
        sign = separation(body or [head])
        spec = columns(sign.cells(head))
        has = [column.meaning for column in spec]
        place = ("lon", "lat") if "lon" in has else ("x", "y")
        heights = {"z", "z_ellipsoidal", "z_sea"}.intersection(has)
        # With angles and without standard errors it is an exterior orientation of another program.
        exterior = "omega" in has and not any(word.startswith("sigma") for word in has)
        if not {"photo", "name"}.intersection(has) or not set(place) <= set(has) or not heights or "role" in has or exterior:
            continue
        at = has.index("photo") if "photo" in has else has.index("name")
        rows = [sign.cells(line) for line in body]
        words = [row[at] for row in rows if len(row) > at]
        # A list of points has the same columns; it names no photographs, of this flight or another.
        if "photo" in has or any(names.find(word) or is_image_word(word) for word in words):
            x, y = has.index(place[0]), has.index(place[1])
            site = _site([rows[0][x], rows[0][y]], False, sign) if place[0] == "lon" and rows and len(rows[0]) > max(x, y) else None
            return FoundPositions("table with named columns", len(words), _count(words, names), _stated(comments), site)
    return _headless_positions(data, names)


def _headless_positions(data: list[str], names: PhotographNames) -> FoundPositions | None:
    """The lines of Pix4D without names of columns: photograph, two coordinates, height, perhaps more numbers."""
    sign = separation(data)
    rows = [sign.cells(line) for line in data]
    if not all(len(row) in (4, 5, 6, 7, 9, 10) and is_image_word(row[0]) and _numeric(row[1:4], sign) for row in rows[:20]):
        return None
    words = [row[0] for row in rows if row]
    return FoundPositions("Pix4D geolocation", len(words), _count(words, names), None, _site(list(rows[0][1:3]), True, sign))


def _numeric(cells: tuple[str, ...], sign: Separation) -> bool:
    values = [sign.number(cell) for cell in cells]
    return bool(values) and all(value is not None and not math.isnan(value) for value in values)


def _site(words: list[str], latitude_first: bool, sign: Separation | None = None) -> tuple[float, float] | None:
    """Longitude and latitude of two words; None where they are none."""
    values = [(sign or Separation("", ".")).number(word) for word in words]
    if len(values) < 2 or values[0] is None or values[1] is None:
        return None
    longitude, latitude = (values[1], values[0]) if latitude_first else (values[0], values[1])
    return (longitude, latitude) if abs(longitude) <= 180.0 and abs(latitude) <= 90.0 else None


def _count(words: list[str], names: PhotographNames) -> int:
    return len({found for word in words if (found := names.find(word))})


def _stated(comments: list[str]) -> str | None:
    codes = [code for line in comments for code in _CODE.findall(line)]
    return f"EPSG:{codes[-1]}" if codes else None


def control_in(text: str, names: PhotographNames) -> FoundControl | None:
    """What a text holds of control; None where it holds none."""
    if text.lstrip().startswith("<"):
        return FoundControl("Metashape markers (XML)", "all") if "<markers" in text else None
    lines = lines_of(text)
    data = [line for _, line in lines.others]
    if len(data) < 2:
        return None
    if looks_like_system(data[0]) and _is_measurement(data[1:]):
        return FoundControl("GCP list of OpenDroneMap", "all", system=data[0].strip())
    comments = [line for _, line in lines.comments]
    for head, body in [(data[0], data[1:]), *((line.lstrip("# "), data) for line in reversed(comments))]:
        sign = separation(body or [head])
        has = [column.meaning for column in columns(sign.cells(head))]
        if "name" not in has or len(has) < 3:
            continue
        own = frozenset(row[has.index("name")] for line in body if len(row := sign.cells(line)) > has.index("name"))
        if {"photo", "col", "row"} <= set(has):
            return FoundControl("control measurements", "marks", own)
        if (
            "photo" not in has
            and ({"x", "y"} <= set(has) or {"lon", "lat"} <= set(has))
            and not any(names.find(one) or is_image_word(one) for one in own)
        ):
            return FoundControl("control points", "points", own, _stated(comments))
    return _headless_control(data, names)


def _is_measurement(data: list[str]) -> bool:
    """Whether the first line holds five numbers (or four, or NaN) and the name of an image."""
    sign = separation(data)
    cells = sign.cells(data[0])
    values = [sign.number(cell) for cell in cells[:5]]
    return len(cells) > 5 and bool(values[0]) and sum(value is not None for value in values) >= 4


def _headless_control(data: list[str], names: PhotographNames) -> FoundControl | None:
    sign = separation(data)
    rows = [sign.cells(line) for line in data]
    if all(len(row) in (4, 5) and is_image_word(row[0]) and _numeric(row[2:4], sign) for row in rows):
        # With four cells it may as well be a list of positions, whose second cell is a number.
        return (
            None
            if all(_numeric(row[1:2], sign) and len(row) == 4 for row in rows)
            else FoundControl("marks of Pix4D", "marks", frozenset(row[1] for row in rows))
        )
    if all(4 <= len(row) <= 7 and row[0] and not names.find(row[0]) and _numeric(row[1:4], sign) for row in rows):
        return (
            None
            if any(is_image_word(row[0]) for row in rows)
            else FoundControl("list of points", "points", frozenset(row[0] for row in rows))
        )
    return None
