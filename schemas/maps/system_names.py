"""Names of reference systems as people write them: "WGS84 UTM 16N", "EPSG 32634", "WGS84 longlat", besides all that PROJ knows."""

import re
from functools import lru_cache

from pyproj import CRS
from pyproj.exceptions import CRSError

_UTM = re.compile(
    r"(WGS[ _]?(?:19)?84|ETRS[ _]?(?:19)?89|NAD[ _]?(?:19)?83)?[ /,_-]*UTM[ /,_-]*(?:ZONE)?[ _-]*(\d{1,2})[ _-]*([NS])?"
)
_ZONES = {"E": 25800, "N": 26900}
"""EPSG codes of zone 0 of ETRS89 and NAD83, which have northern zones only"""
_DEGREES = re.compile(r"(WGS[ _]?(?:19)?84)?[ /,_-]*(LONG?LAT|LAT[ -]?LONG?|LON[ /,]+LAT|LAT[ /,]+LON)")
_CODE_ANYWHERE = re.compile(r"EPSG[: ]{1,2}(\d{4,6})(\+(?:EPSG:)?(\d{4,6}))?", re.IGNORECASE)
_DEFINED = re.compile(r"\w+::?\w|\d{4,6}$|\+(PROJ|INIT)|[A-Z_]+\[|\{", re.IGNORECASE)
"""a code, a PROJ string, WKT or JSON, and no name"""
_CODE = re.compile(r"EPSG[: ]*(\d{4,6})( *\+ *(?:EPSG:)?(\d{4,6}))?\b", re.IGNORECASE)


@lru_cache(maxsize=64)
def known_crs(text: str) -> CRS | None:
    """The reference system that a text names; None where PROJ knows none. Longitude and latitude come in either order: callers use
    `always_xy`, and tell by the place which order a file has."""
    words = _spelled(text.strip().upper()) or text.strip()
    try:
        found = CRS.from_user_input(words)
    except CRSError:
        return None
    # PROJ takes the nearest name it has, IGS20 for "lat lon".
    return found if _DEFINED.match(words) or _letters(words) in _letters(found.name) else None


def _letters(words: str) -> str:
    return re.sub(r"[^a-z0-9]", "", words.lower())


def _spelled(words: str) -> str | None:
    """The EPSG code of a name that PROJ does not know."""
    if match := _UTM.fullmatch(words):
        return _zone(match[1] or "WGS84", int(match[2]), match[3])
    if _DEGREES.fullmatch(words):
        return "EPSG:4326"
    match = _CODE.fullmatch(words.rstrip(".;, "))
    return f"EPSG:{match[1]}{f'+{match[3]}' * bool(match[3])}" if match else None


def _zone(datum: str, zone: int, hemisphere: str | None) -> str | None:
    if datum[0] in _ZONES:
        return f"EPSG:{_ZONES[datum[0]] + zone}" if hemisphere != "S" else None
    return f"EPSG:{(32600 if hemisphere == 'N' else 32700) + zone}" if hemisphere else None


def code_in(text: str) -> str | None:
    """The EPSG code that a text names anywhere, as EPSG:32634; the last of several."""
    found = [f"EPSG:{first}{f'+{vertical}' * bool(vertical)}" for first, _, vertical in _CODE_ANYWHERE.findall(text)]
    return found[-1] if found else None
