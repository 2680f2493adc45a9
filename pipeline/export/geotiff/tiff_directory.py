"""The directories of TIFF files, little-endian, classic (32 bits) and big (64 bits): read, and written as bytes.

TIFF 6.0 (Adobe 1992), section 2, and the BigTIFF design of Aware Systems (2008): a directory is a list of fields (tag, type, count,
value), sorted by tag; a value that does not fit into its field stands elsewhere in the file.
"""

import struct
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
"""bytes of a value, by TIFF's number of its type"""
_NUMBERS = {1: "u1", 3: "<u2", 4: "<u4", 16: "<u8"}
SHORT, LONG, LONG8 = 3, 4, 16

REDUCED, WIDTH, HEIGHT, TILE_OFFSETS, TILE_SIZES = 254, 256, 257, 324, 325
"""tags"""


class TiffField(NamedTuple):
    """A field of a directory: TIFF's number of its type, how many values, and these as they stand in the file."""

    kind: int
    values: int
    data: bytes

    @property
    def numbers(self) -> np.ndarray:
        """(values,) unsigned integers."""
        return np.frombuffer(self.data, _NUMBERS[self.kind])


Directory = dict[int, TiffField]
"""fields by tag"""


class Form(NamedTuple):
    """How numbers stand in a kind of TIFF: its version, and the formats of its head, of the number of fields, of a field
    without its value and of a place in the file."""

    version: int
    head: str
    number: str
    field: str
    place: str


CLASSIC = Form(42, "<2sH", "<H", "<HHI", "<I")
BIG = Form(43, "<2sHHH", "<Q", "<HHQ", "<Q")


def field(kind: int, *values: int) -> TiffField:
    """A field of unsigned integers."""
    return TiffField(kind, len(values), np.array(values, _NUMBERS[kind]).tobytes())


def directories(path: Path) -> list[Directory]:
    """All directories of a file that GDAL wrote on any machine of ours, in their order."""
    with path.open("rb") as file:
        form = BIG if struct.unpack("<2sH", file.read(4))[1] == BIG.version else CLASSIC
        at, found = _number(file, form.place, struct.calcsize(form.head)), []
        while at:
            directory, at = _directory(file, form, at)
            found.append(directory)
    return found


def _number(file: BinaryIO, form: str, at: int) -> int:
    file.seek(at)
    return int(struct.unpack(form, file.read(struct.calcsize(form)))[0])


def _directory(file: BinaryIO, form: Form, at: int) -> tuple[Directory, int]:
    """The directory there, and where the next one is."""
    count, first = _number(file, form.number, at), at + struct.calcsize(form.number)
    head, room = struct.calcsize(form.field), struct.calcsize(form.place)
    file.seek(first)
    content = file.read(count * (head + room) + room)
    found: Directory = {}
    for start in range(0, count * (head + room), head + room):
        tag, kind, values = struct.unpack_from(form.field, content, start)
        size = values * _BYTES[kind]
        if size <= room:
            data = content[start + head : start + head + size]
        else:
            file.seek(struct.unpack_from(form.place, content, start + head)[0])
            data = file.read(size)
        found[tag] = TiffField(kind, values, data)
    return found, int(struct.unpack_from(form.place, content, count * (head + room))[0])


def encoded(directory: Directory, form: Form, at: int, last: bool) -> bytes:
    """The bytes of a directory that stands at a place, followed by the values that do not fit into it; the next one follows these,
    unless it is the last."""
    room = struct.calcsize(form.place)
    length = struct.calcsize(form.number) + len(directory) * (struct.calcsize(form.field) + room) + room
    fields, values = struct.pack(form.number, len(directory)), b""
    for tag, (kind, count, data) in sorted(directory.items()):
        fields += struct.pack(form.field, tag, kind, count)
        if len(data) <= room:
            fields += data.ljust(room, b"\0")
        else:
            fields += struct.pack(form.place, at + length + len(values))
            values += data + bytes(-len(data) % 8)
    end = length + len(values)
    end += -(at + end) % 8
    return (fields + struct.pack(form.place, 0 if last else at + end) + values).ljust(end, b"\0")
