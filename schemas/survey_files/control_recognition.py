"""Which files hold control, by their first lines: what lies beside photographs is used or named.

Only the head of a file decides here; its reader judges every line. Formats are described where they are read.
"""

import re
from dataclasses import dataclass

from orthomill.schemas.maps.system_names import known_crs
from orthomill.schemas.survey_files.photograph_names import PhotographNames, is_image_word
from orthomill.schemas.survey_files.recognition import are_numbers, count_named, stated_in
from orthomill.schemas.survey_files.sniffed_table import Lines, Separation, lines_of, separation
from orthomill.schemas.survey_files.table_heads import possible_heads

_GSI = re.compile(r"\s*\*?(11|41)\d{4}[+-]\w{8}")
_GSI_NAME = re.compile(r"^\s*\*?11\d{4}[+-]0*(\w+)", re.MULTILINE)
_TITLES = 4
"""lines above the measurements of a GCP list"""


@dataclass(frozen=True)
class FoundControl:
    """A file of control: its format, what it holds, the points that it names, the reference system that it states ("": none), and
    how many of the photographs it names (None: it cannot be told)."""

    format: str
    holds: str
    """all, points or marks"""
    names: frozenset[str] = frozenset()
    system: str | None = None
    photographs: int | None = None

    @property
    def of_others(self) -> bool:
        """Whether it is about other photographs than the project's."""
        return self.photographs == 0


def control_in(text: str, names: PhotographNames) -> FoundControl | None:
    """What a text holds of control; None where it holds none."""
    if text.lstrip().startswith(("<", "{")):
        return _control_in_markup(text, names)
    lines = lines_of(text, ("#", "//", ";"))
    data = [line for _, line in lines.others]
    if not data:
        return None
    if _GSI.match(data[0]):
        return FoundControl("Leica GSI", "points", frozenset(_GSI_NAME.findall(text)))
    found = gcp_list_in(lines, names)
    # Below a line that is no system, what looks like such a list may be a table whose columns have names.
    if found and found.system and known_crs(found.system) is not None:
        return found
    # The semicolon is no comment there.
    plain = lines_of(text)
    table = _table_in(plain, names)
    if found and not (table and table.holds == "all"):
        return found
    return table or _headless_control([line for _, line in plain.others], names)


def _table_in(lines: Lines, names: PhotographNames) -> FoundControl | None:
    """What a table with named columns holds."""
    for head in possible_heads(lines):
        sign, has = head.separation, [column.meaning for column in head.columns]
        if "name" not in has or len(has) < 3:
            continue
        rows = [row for _, line in head.data if len(row := sign.cells(line)) > has.index("name")]
        own = frozenset(row[has.index("name")] for row in rows)
        if head.has_marks:
            seen = [row[has.index("photo")] for row in rows if len(row) > has.index("photo")]
            what = ("table of points and measurements", "all") if head.has_places else ("control measurements", "marks")
            return FoundControl(*what, own, stated_in(lines) if head.has_places else None, count_named(seen, names))
        if "photo" not in has and head.has_places and not any(names.find(one) or is_image_word(one) for one in own):
            return FoundControl("control points", "points", own, stated_in(lines))
    return None


def _control_in_markup(text: str, names: PhotographNames) -> FoundControl | None:
    """Control in XML and JSON."""
    head = text[:4000]
    if "<markers" in text:
        seen = re.findall(r"<camera\b[^>]*\blabel=\"([^\"]+)\"", text)
        return FoundControl("Metashape markers (XML)", "all", photographs=count_named(seen, names) if seen else None)
    if "<LandXML" in head and "<CgPoint " in text:
        return FoundControl("LandXML", "points", frozenset(re.findall(r"<CgPoint\b[^>]*\bname=\"([^\"]+)\"", text)))
    points = frozenset(re.findall(r"<NamePt>\s*([^<]*?)\s*</NamePt>", text))
    if "MesureAppuisFlottants" in head or "MesureAppuiFlottant1Im" in head:
        seen = re.findall(r"<NameIm>\s*([^<]*?)\s*</NameIm>", text)
        return FoundControl("MicMac measurements", "marks", points, photographs=count_named(seen, names))
    if "DicoAppuisFlottant" in head:
        return FoundControl("MicMac points", "points", points)
    if '"observations"' in text and '"points"' in head:
        seen = re.findall(r'"shot_id"\s*:\s*"([^"]+)"', text)
        return FoundControl("ground_control_points.json of OpenSfM", "all", photographs=count_named(seen, names))
    return None


def gcp_list_in(lines: Lines, names: PhotographNames) -> FoundControl | None:
    """The GCP list of lines: measurements, at most a few lines below its beginning."""
    data = [line for _, line in lines.others]
    sign = separation(data)
    seen = [_measured_in(line, sign, names) for line in data]
    first = next((i for i, word in enumerate(seen[: _TITLES + 1]) if word), None)
    if first is None:
        return None
    titles = data[:first]
    known = next((line.strip() for line in titles if known_crs(line) is not None), None)
    # Fewer numbers may as well be a number, a position and its photograph.
    if known is None and sum(sign.coordinate(cell) is not None for cell in sign.cells(data[first])[:8]) < 5:
        return None
    system = known or (titles[0].strip() if titles else None)
    found = count_named([word for word in seen if word], names)
    return FoundControl("GCP list of OpenDroneMap", "all", system=system or stated_in(lines) or "", photographs=found)


def _measured_in(line: str, sign: Separation, names: PhotographNames) -> str | None:
    """The photograph of a measurement: behind three numbers or more, with two others beside it; None where the line is none."""
    cells = sign.cells(line)
    numbers = [sign.coordinate(cell) is not None for cell in cells]
    for i, cell in enumerate(cells[:8]):
        if i >= 3 and sum(numbers[:i]) >= 3 and sum(numbers[: i + 3]) >= 4 and (is_image_word(cell) or names.find(cell)):
            return cell
    return None


def _headless_control(data: list[str], names: PhotographNames) -> FoundControl | None:
    sign = separation(data)
    rows = [sign.cells(line) for line in data]
    if all(len(row) in (4, 5) and is_image_word(row[0]) and are_numbers(row[2:4], sign) for row in rows):
        seen = count_named([row[0] for row in rows], names)
        # With four cells it may as well be a list of positions, whose second cell is a number.
        return (
            None
            if all(are_numbers(row[1:2], sign) and len(row) == 4 for row in rows)
            else FoundControl("marks of Pix4D", "marks", frozenset(row[1] for row in rows), photographs=seen)
        )
    if all(4 <= len(row) <= 7 and row[0] and not names.find(row[0]) and are_numbers(row[1:4], sign) for row in rows):
        return (
            None
            if any(is_image_word(row[0]) for row in rows)
            else FoundControl("list of points", "points", frozenset(row[0] for row in rows))
        )
    return None
