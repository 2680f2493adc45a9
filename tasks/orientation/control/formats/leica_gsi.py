"""Coordinates of Leica's total stations and receivers: GSI-8 and GSI-16.

A line is a block of words of 16 or 24 letters: word index (2 digits), additional information (4), sign and 8 or 16 digits. 11 is
the name of the point, 81 easting, 82 northing, 83 height; the last digit of the additional information is the unit. Source: Leica
Geosystems, "GSI ONLINE for Leica TPS and DNA" (2002), data format; TPS1100 user manual, p. 108.
"""

import re

from orthomill.schemas.survey_files.sniffed_table import lines_of
from orthomill.tasks.orientation.control.control_rows import Row, Rows, StatedControl, stated_row

_WORD = re.compile(r"(\d\d)([\d.]{4})([+-])(\w{16}|\w{8})(?=\s|$)")
_UNITS = {"0": 0.001, "1": 0.001 * 0.3048, "6": 0.0001, "7": 0.0001 * 0.3048, "8": 0.00001}
"""m, by the last digit of the additional information: millimetres, feet / 1000, 0.1 mm, feet / 10000, 0.01 mm"""
_COORDINATES = {"81": "x", "82": "y", "83": "z"}


def is_gsi(text: str) -> bool:
    """Whether a text is of words of GSI."""
    first = next((line for _, line in lines_of(text).others), "")
    return bool(re.match(r"\s*\*?(11|41)\d{4}[+-]\w{8}", first))


def gsi_rows(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The points that have coordinates; what is wrong is added to `mistakes`. Measured angles and distances (21 to 39) are no
    coordinates, and their lines are skipped."""
    rows: list[Row] = []
    skipped = 0
    for number, line in lines_of(text).others:
        words = {index: (info, sign, data) for index, info, sign, data in _WORD.findall(line)}
        name = words["11"][2].lstrip("0") if "11" in words else ""
        if not name or not {"81", "82"} <= words.keys():
            skipped += 1
            continue
        found = {"z": "nan"}
        for index, coordinate in _COORDINATES.items():
            if index in words:
                info, sign, data = words[index]
                if not data.isdigit() or info[3] not in _UNITS:
                    mistakes.append(f"Control points file, line {number}, point {name}: the word {index} cannot be read: '{data}'.")
                    continue
                found[coordinate] = repr(float(f"{sign}{data}") * _UNITS[info[3]])
        if {"x", "y"} <= found.keys():
            rows.append((number, stated_row(name, found, stated)))
    if not rows and not mistakes:
        mistakes.append(
            "The control points file (Leica GSI) holds measurements, but no coordinates (81, 82, 83); export coordinates from the "
            "instrument."
        )
    return Rows("Leica GSI", tuple(rows), skipped=skipped)
