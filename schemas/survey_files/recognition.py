"""Which files hold positions of photographs, by their first lines: what lies beside photographs is used or named.

Only the head of a file decides here; its reader judges every line. Formats are described where they are read.
"""

import math
import re
from dataclasses import dataclass

from orthomill.schemas.maps.system_names import code_in, known_crs
from orthomill.schemas.survey_files.photograph_names import EXTENSIONS, PhotographNames, is_image_word
from orthomill.schemas.survey_files.sniffed_table import Lines, Separation, lines_of, separation
from orthomill.schemas.survey_files.table_heads import possible_heads

NAMED_IMAGE = re.compile(rf"^\s*(.*?\.(?:{'|'.join(sorted(EXTENSIONS))}))(?=[\s,;]|$)[\s,;]*(.*)$", re.IGNORECASE)
"""the name of an image file, which may hold blanks, and what follows it"""
SOLUTION_LINE = re.compile(r"^\s*\d{4}[/-]\d\d[/-]\d\d[\s,;]+\d\d:\d\d:\d\d(\.\d+)?([\s,;]+[-+]?\d+(\.\d*)?){5}")
"""an epoch of RTKLIB: day, time, and five numbers or more"""
_MARK = re.compile(r"([-+]?\d+\.\d+)\s*,\s*Lat\s+([-+]?\d+\.\d+)\s*,\s*Lon\s+[-+]?[\d.]+\s*,\s*Ellh")
_SYSTEMS = ("EPSG:", "+PROJ", "WGS84", "WGS 84", "PROJCS[", "PROJCRS[", "GEOGCS[", "COMPD_CS[", "ETRS89", "NAD83")
_LOOKED_AT = 2000
"""lines of a text in which names of photographs are looked for"""
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
    if SOLUTION_LINE.match(data[0]) or ("%" in comments and ("latitude(" in comments.lower() or "x-ecef" in comments.lower())):
        return FoundPositions("RTKLIB or Emlid solution (.pos)", len(data), None, "EPSG:4979", _site(data[0].split()[2:4], True))
    if len(data) > 1 and looks_like_system(data[0]) and (found := _geo_file(data, names)):
        return found
    return _table_of_positions(lines, data, names)


def _geo_file(data: list[str], names: PhotographNames) -> FoundPositions | None:
    """OpenDroneMap's geo.txt: photographs and two coordinates or more below a reference system."""
    found = [parts for line in data[1:] if (parts := of_geo_line(line))]
    if not found:
        return None
    sign = separation([rest for _, rest in found])
    if not are_numbers(sign.cells(found[0][1])[:2], sign):
        return None
    words = [name for name, _ in found]
    if not any(is_image_word(word) or names.find(word) for word in words):
        return None
    known = known_crs(data[0])
    site = _site(list(sign.cells(found[0][1])[:2]), False, sign) if known is not None and known.is_geographic else None
    return FoundPositions("geo.txt of OpenDroneMap", len(found), count_named(words, names), data[0].strip(), site)


def of_geo_line(line: str) -> tuple[str, str] | None:
    """The name of the photograph of a line, which may hold blanks if it ends as that of an image, and what follows it."""
    if match := NAMED_IMAGE.match(line):
        return match[1], match[2]
    parts = re.split(r"[\s,;]+", line.strip(), maxsplit=1)
    return (parts[0], parts[1]) if len(parts) == 2 else None


def _table_of_positions(lines: Lines, data: list[str], names: PhotographNames) -> FoundPositions | None:
    for head in possible_heads(lines):
        sign, body = head.separation, [line for _, line in head.data]
        has = [column.meaning for column in head.columns]
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
            # Metashape names its columns X/Longitude, whichever they hold.
            degrees = place[0] == "lon" or "lon" in head.names[x].lower()
            site = _site([rows[0][x], rows[0][y]], False, sign) if degrees and rows and len(rows[0]) > max(x, y) else None
            return FoundPositions("table with named columns", len(words), count_named(words, names), stated_in(lines), site)
    return _headless_positions(data, names)


def _headless_positions(data: list[str], names: PhotographNames) -> FoundPositions | None:
    """The lines of Pix4D without names of columns: photograph, two coordinates, height, perhaps more numbers."""
    sign = separation(data)
    rows = [sign.cells(line) for line in data]
    if not all(
        len(row) in (4, 5, 6, 7, 9, 10) and (is_image_word(row[0]) or names.find(row[0])) and are_numbers(row[1:4], sign)
        for row in rows[:20]
    ):
        return None
    words = [row[0] for row in rows if row]
    return FoundPositions("Pix4D geolocation", len(words), count_named(words, names), None, _site(list(rows[0][1:3]), True, sign))


def are_numbers(cells: tuple[str, ...], sign: Separation) -> bool:
    """Whether all cells are numbers that are known."""
    values = [sign.coordinate(cell) for cell in cells]
    return bool(values) and all(value is not None and not math.isnan(value) for value in values)


def _site(words: list[str], latitude_first: bool, sign: Separation | None = None) -> tuple[float, float] | None:
    """Longitude and latitude of two words; None where they are none."""
    values = [(sign or Separation("", ".")).coordinate(word) for word in words]
    if len(values) < 2 or values[0] is None or values[1] is None:
        return None
    longitude, latitude = (values[1], values[0]) if latitude_first else (values[0], values[1])
    if abs(latitude) > 90.0 >= abs(longitude):
        # Exchanged, as the reader of the file finds as well.
        longitude, latitude = latitude, longitude
    return (longitude, latitude) if abs(longitude) <= 180.0 and abs(latitude) <= 90.0 else None


def words_that_name(text: str, names: PhotographNames) -> int:
    """How many of the project's photographs a text names, whatever its format."""
    lines = [line for _, line in lines_of(text).others][:_LOOKED_AT]
    sign = separation(lines)
    return count_named([cell for line in lines for cell in sign.cells(line)], names)


def count_named(words: list[str], names: PhotographNames) -> int:
    """How many of the project's photographs words mean."""
    return len({found for word in words if (found := names.find(word))})


def stated_in(lines: Lines) -> str | None:
    """The reference system that comments name."""
    return code_in(" ".join(line for _, line in lines.comments))
