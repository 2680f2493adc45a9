"""EXIF as it stands in a file: directories of numbered entries, for what GDAL leaves out.

GDAL reads the EXIF of JPEG and most of that of TIFF. It leaves out the chunk eXIf of PNG, make, model and orientation of TIFF, some
newer tags, and the notes of makers, of which it returns the first characters. All of these have one form, that of TIFF. Everything
that an entry claims (offsets, counts) is checked against the bytes that are there.

Sources: TIFF 6.0, section 2; CIPA DC-008 (EXIF), 4.6; the entries of DJI's notes as ExifTool documents them.
"""

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from orthomill.schemas.memory import MIB

_MAIN = {0x010E: "ImageDescription", 0x010F: "Make", 0x0110: "Model", 0x0112: "Orientation", 0x0132: "DateTime"}
_EXIF = {
    0x829A: "ExposureTime",
    0x9003: "DateTimeOriginal",
    0x9011: "OffsetTimeOriginal",
    0x9290: "SubSecTime",
    0x9291: "SubSecTimeOriginal",
    0x920A: "FocalLength",
    0xA002: "PixelXDimension",
    0xA003: "PixelYDimension",
    0xA20E: "FocalPlaneXResolution",
    0xA20F: "FocalPlaneYResolution",
    0xA210: "FocalPlaneResolutionUnit",
    0xA404: "DigitalZoomRatio",
    0xA405: "FocalLengthIn35mmFilm",
    0xA431: "BodySerialNumber",
}
_GPS = {
    1: "GPSLatitudeRef",
    2: "GPSLatitude",
    3: "GPSLongitudeRef",
    4: "GPSLongitude",
    5: "GPSAltitudeRef",
    6: "GPSAltitude",
    0x12: "GPSMapDatum",
    0x1F: "GPSHPositioningError",
}
_DJI = {
    1: "MakerNote:Make",
    6: "MakerNote:Pitch",
    7: "MakerNote:Yaw",
    8: "MakerNote:Roll",
    9: "MakerNote:CameraPitch",
    10: "MakerNote:CameraYaw",
    11: "MakerNote:CameraRoll",
}
_EXIF_AT, _GPS_AT, _NOTE = 0x8769, 0x8825, 0x927C
_FORMATS = {
    1: "B",
    2: "s",
    3: "H",
    4: "I",
    5: "II",
    6: "b",
    7: "s",
    8: "h",
    9: "i",
    10: "ii",
    11: "f",
    12: "d",
    13: "I",
    16: "Q",
    18: "Q",
}
"""Format of one value by the type of an entry, as `struct` writes it."""
_MOST_ENTRIES, _MOST_BYTES = 500, 2000


@dataclass(frozen=True)
class _Entry:
    """`at`: where its values begin; `count` of them, of a `kind`."""

    kind: int
    count: int
    at: int


def exif_tags(content: bytes | mmap.mmap) -> dict[str, str]:
    """The known tags of EXIF or of a TIFF file, as text in the form that GDAL gives them; empty where it is none.

    Notes of DJI's earlier drones are under MakerNote:CameraYaw and the like, degrees.
    """
    block = _Block.of(content)
    if block is None:
        return {}
    main = block.directory(block.first)
    tags = block.named(main, _MAIN)
    exif = block.directory(block.number(main.get(_EXIF_AT)))
    tags |= block.named(exif, _EXIF) | block.named(block.directory(block.number(main.get(_GPS_AT))), _GPS)
    if note := exif.get(_NOTE):
        tags |= block.notes(note.at)
    return tags


@dataclass(frozen=True)
class _Block:
    """Bytes in the form of TIFF: byte order, the widths of counts and offsets, and where the first directory begins."""

    content: bytes | mmap.mmap
    order: str
    wide: bool
    first: int

    @classmethod
    def of(cls, content: bytes | mmap.mmap) -> "_Block | None":
        order = {b"II": "<", b"MM": ">"}.get(content[:2])
        if order is None or len(content) < 16:
            return None
        wide = struct.unpack_from(f"{order}H", content, 2)[0] == 43
        return cls(content, order, wide, struct.unpack_from(f"{order}{'Q' if wide else 'I'}", content, 8 if wide else 4)[0])

    def directory(self, at: int | None) -> dict[int, _Entry]:
        """The entries of a directory by their numbers; empty where it does not lie within the bytes."""
        head, size, count, offset = ("Q", 20, "Q", "Q") if self.wide else ("H", 12, "I", "I")
        start = struct.calcsize(f"<{head}")
        if not at or at + start > len(self.content):
            return {}
        number = struct.unpack_from(f"{self.order}{head}", self.content, at)[0]
        # A damaged directory claims thousands of entries.
        if number > _MOST_ENTRIES or at + start + number * size > len(self.content):
            return {}
        places = range(at + start, at + start + number * size, size)
        return {tag: entry for place in places for tag, entry in self._entry(place, count, offset)}

    def _entry(self, place: int, count: str, offset: str) -> Iterator[tuple[int, _Entry]]:
        tag, kind, values = struct.unpack_from(f"{self.order}HH{count}", self.content, place)
        if kind not in _FORMATS:
            return
        inside = place + struct.calcsize(f"<HH{count}")
        size = values * struct.calcsize(f"<{_FORMATS[kind]}")
        at = (
            inside
            if size <= struct.calcsize(f"<{offset}")
            else struct.unpack_from(f"{self.order}{offset}", self.content, inside)[0]
        )
        if at + size <= len(self.content):
            yield tag, _Entry(kind, values, at)

    def named(self, entries: dict[int, _Entry], names: dict[int, str]) -> dict[str, str]:
        return {names[tag]: text for tag, entry in entries.items() if tag in names and (text := self._text(entry))}

    def notes(self, at: int) -> dict[str, str]:
        """DJI's notes: a directory whose first entry names the maker; those of others have other forms.

        A program that wrote the tags anew in the other byte order left the notes, which it does not know, as they were.
        """
        for order in "<>":
            own = replace(self, order=order)
            found = own.named(own.directory(at), _DJI)
            if found.get("MakerNote:Make", "").startswith("DJI"):
                return found
        return {}

    def number(self, entry: _Entry | None) -> int | None:
        """The offset that an entry holds."""
        return None if entry is None or entry.kind not in (4, 13, 16, 18) or entry.count != 1 else int(self._text(entry))

    def _text(self, entry: _Entry) -> str:
        form = _FORMATS[entry.kind]
        if form == "s":
            raw = self.content[entry.at : entry.at + min(entry.count, _MOST_BYTES)]
            return raw.split(b"\0")[0].decode("utf-8", "replace").strip()
        values = struct.unpack_from(f"{self.order}{form * min(entry.count, 16)}", self.content, entry.at)
        if len(form) == 2:
            pairs = zip(values[::2], values[1::2], strict=True)
            return " ".join(f"({top / bottom if bottom else 0.0:.12g})" for top, bottom in pairs)
        return " ".join(f"{value:.9g}" if isinstance(value, float) else str(value) for value in values)


def png_exif(path: Path) -> bytes:
    """The chunk eXIf of a PNG; empty without one. Source: PNG specification, third edition, 11.3.4.5."""
    with open(path, "rb") as file:
        file.seek(8)
        while len(head := file.read(8)) == 8:
            size = int.from_bytes(head[:4], "big")
            if head[4:] == b"eXIf":
                return file.read(size) if size < MIB else b""
            # Offset of the next chunk: the content and its check sum.
            file.seek(size + 4, 1)
    return b""


def jpeg_exif(path: Path) -> bytes:
    """The EXIF of a JPEG, without its six letters of introduction; empty without one."""
    with open(path, "rb") as file:
        file.seek(2)
        while len(head := file.read(4)) == 4 and head[0] == 0xFF and head[1] not in (0xDA, 0xFF):
            content = file.read(int.from_bytes(head[2:], "big") - 2 if head[2:] > b"\0\1" else 0)
            if head[1] == 0xE1 and content.startswith(b"Exif\0"):
                return content[6:]
    return b""


def tiff_tags(path: Path) -> dict[str, str]:
    """The known tags of a TIFF file itself."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return exif_tags(content)
