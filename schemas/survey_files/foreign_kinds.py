"""Files of other kinds than lists: what they are, and how a list is made of them.

Whoever has control or positions in a spreadsheet, a map program or a receiver is told what to save instead.
"""

import re

_SHEET = "save its table as CSV (File, Save as) and give that file"
_MAP = "export its points from the map program as a table with names, coordinates and heights (CSV), and give that file"
_OTHER = "give the list of points or positions, as text"
_BY_BYTES: tuple[tuple[bytes, str, str], ...] = (
    (b"PK\x03\x04", "a spreadsheet (.xlsx, .ods) or another zip archive", _SHEET),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a spreadsheet of Excel 97 (.xls)", _SHEET),
    (b"\x00\x00\x27\x0a", "a shapefile", _MAP),
    (b"SQLite format 3\0", "a GeoPackage or another database", _MAP),
    (b"AC10", "a drawing (DWG)", _MAP),
    (b"%PDF", "a PDF document", "ask for the coordinates as text or CSV and give that file"),
    (b"\xff\xd8\xff", "a photograph (JPEG)", _OTHER),
    (b"\x89PNG", "a picture (PNG)", _OTHER),
    (b"II*\0", "a picture (TIFF)", _OTHER),
    (b"MM\0*", "a picture (TIFF)", _OTHER),
    (b"LASF", "a point cloud (LAS)", _OTHER),
    (b"\x1f\x8b", "a compressed file (gzip)", "unpack it first"),
)
_BY_TEXT: tuple[tuple[str, str, str], ...] = (
    (r"(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*<kml\b", "a KML file, whose heights are mostly those of the terrain below", _MAP),
    (r"(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*<gpx\b", "a GPX file of a navigation receiver", _MAP),
    (r"(<\?xml[^>]*>\s*)?<BlocksExchange\b", "a block of ContextCapture (BlocksExchange)", "export its control points as text"),
    (r"\s*(<!DOCTYPE html|<html\b)", "a web page, perhaps the refusal of a download", "download the file anew"),
    (r"\s*\{\s*\"type\"\s*:\s*\"FeatureCollection\"", "a GeoJSON file", _MAP),
    (r"\s*(999\s*\n[^\n]*\n\s*)?0\s*\n\s*SECTION\b", "a drawing (DXF)", _MAP),
    (r"\$G[PNLAB](GGA|RMC|GSA|GSV|GST|VTG)", "a log of a receiver (NMEA)", "convert it to positions of the exposures (PPK) first"),
    (
        r"\s+\d\.\d\d\s+(OBSERVATION|N:|NAVIGATION|MIXED)",
        "raw observations of a receiver (RINEX)",
        "process them to positions (PPK) first",
    ),
)


def binary_kind(data: bytes) -> str | None:
    """What bytes that are no text are and what to do about it, as the end of a sentence; None where nothing is known."""
    return next((f"is {what}; {remedy}" for head, what, remedy in _BY_BYTES if data.startswith(head)), None)


def text_kind(text: str) -> str | None:
    """The same for texts that are no list."""
    head = text[:2000]
    return next(
        (f"is {what}; {remedy}" for mark, what, remedy in _BY_TEXT if re.match(mark, head, re.DOTALL | re.IGNORECASE)), None
    )
