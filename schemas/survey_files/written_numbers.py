"""Numbers as people write them: signs between thousands, degrees with minutes and seconds, hemispheres, units behind.

What can be read in two ways is no number: "391,000" is a thousand times too large in one country and right in another.
"""

import math
import re

UNKNOWN = frozenset({"", "nan", "n/a", "na", "none", "null", "-", "--", "?"})
"""cells that say that a number is not known"""

STAND_INS = frozenset({-999.0, 9999.0, -9999.0, 99999.0, -99999.0, 999999.0, -999999.0, 32767.0, -32767.0, -32768.0})
"""heights that programs write where they know none: no ground and no camera has any of them"""

# Not `float` alone, which takes "1_000", "infinity" and digits of other scripts.
_PLAIN = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
# Between thousands stand an apostrophe (Switzerland), blanks that do not break (France) or the sign that is not that of decimals.
_APART = "'\u2019\u00a0\u202f "


def _thousands(sign: str, apart: str) -> re.Pattern[str]:
    return re.compile(
        rf"[+-]?\d{{1,3}}(([{_APART}]\d{{3}})+({sign}\d*)?|({apart}\d{{3}})+{sign}\d*|({apart}\d{{3}}){{2,}})", re.ASCII
    )


_THOUSANDS = {".": _thousands("[.]", ","), ",": _thousands(",", "[.]")}
_EITHER = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}", re.ASCII)
"""beside decimal commas: 391.000 is 391000, or was written by another hand"""
_METRES = re.compile(r"(.*?\d)\s*m(?:et(?:er|re)s?)?(?:\s+(above|below)\s+sea\s+level)?", re.IGNORECASE)
# Degrees and their parts, apart by signs, colons or blanks; exiftool writes "45 deg 1' 41.06" N".
_ANGLE = re.compile(
    r"([+-]?)(\d{1,3}(?:\.\d*)?)\s*(?:°|º|deg\b|d\b|:|\s)?\s*"
    r"(?:(\d{1,2}(?:\.\d*)?)\s*(?:'|′|’|m\b|:|\s)?\s*(?:(\d{1,2}(?:\.\d*)?)\s*(?:\"|″|”|''|′′|s\b)?)?)?",
    re.IGNORECASE | re.ASCII,
)
_HEMISPHERE = re.compile(r"([NSEW])\s*(.+)|(.+?)\s*([NSEW])", re.IGNORECASE)  # O is east in German lists, and west in Spanish ones
_SIGNED = re.compile(r"[°º:'′’]|deg|d\b", re.IGNORECASE)


def number(cell: str, decimal: str = ".") -> float | None:
    """The number of a cell: None where it is none, NaN where it says that it is not known; `decimal`: the sign before decimals."""
    own = cell.strip()
    if own.lower() in UNKNOWN:
        return math.nan
    if match := _METRES.fullmatch(own):
        value = _decimal(match[1].strip(), decimal)
        return -value if value is not None and (match[2] or "").lower() == "below" else value
    return _decimal(own, decimal)


def coordinate(cell: str, decimal: str = ".") -> float | None:
    """The number of a cell; degrees with minutes or with the letter of a hemisphere are decimal degrees, those of the south and the
    west negative."""
    if (value := number(cell, decimal)) is not None:
        return value
    return _degrees(cell.strip().replace(",", ".") if decimal == "," else cell.strip())


def is_plain(cell: str) -> bool:
    """Whether a cell is digits with a point at most, perhaps an exponent."""
    return bool(_PLAIN.fullmatch(cell.strip()))


def is_thousands(word: str, decimal: str = ".") -> bool:
    """Whether a word is a number with signs between its thousands."""
    return bool(_THOUSANDS[decimal].fullmatch(word))


def _decimal(own: str, decimal: str) -> float | None:
    if decimal == "," and _EITHER.fullmatch(own):
        return None
    if is_thousands(own, decimal):
        own = re.sub(rf"[{_APART}{',' if decimal == '.' else '.'}]", "", own)
    own = own.replace(",", ".") if decimal == "," else own
    return float(own) if _PLAIN.fullmatch(own) else None


def _degrees(own: str) -> float | None:
    """Decimal degrees of degrees with minutes and seconds, or with a hemisphere."""
    match = _HEMISPHERE.fullmatch(own)
    letter = (match[1] or match[4]).upper() if match else ""
    words = (match[2] or match[3]).strip() if match else own
    parts = _ANGLE.fullmatch(words)
    # Two numbers with a blank between them may be anything; three are degrees, minutes and seconds.
    if parts is None or not (letter or parts[4] or (parts[3] and _SIGNED.search(words))):
        return None
    degrees, minutes, seconds = (float(part or 0.0) for part in parts.groups()[1:])
    # 7.5 degrees and 30 minutes is said by nobody: one of the two is another number.
    if minutes >= 60.0 or seconds >= 60.0 or (minutes and degrees % 1.0) or (seconds and minutes % 1.0) or degrees > 360.0:
        return None
    value = degrees + minutes / 60.0 + seconds / 3600.0
    return -value if parts[1] == "-" or letter in ("S", "W") else value
