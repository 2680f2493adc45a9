"""A LAZ file made of others: their compressed chunks one after the other, of which hardly any is decoded.

Chunks of LASzip know nothing of each other, but all except the last have the same number of points: readers compute from it where
a point is, and where chunks may have any size, `seek` of lazrs 0.8 finds other points. So the full chunks of all parts come
first, and the points behind them, less than a chunk of each part, are compressed anew, in chunks of the same number.

Source: LASzip (Isenburg 2013), ASPRS LAS 1.4 R15.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import LasZipVlr

_PLACE = struct.Struct("<q")
"""of the table of chunks, before the first one"""
_LASZIP = "laszip encoded"
"""the user of its variable record"""


@dataclass(frozen=True)
class _CloudPart:
    """A LAZ file and its header, as it is in the file."""

    path: Path
    header: laspy.LasHeader

    @property
    def packing(self) -> bytes:
        """LASzip's own record."""
        return next(one.record_data_bytes() for one in self.header.vlrs if one.user_id == _LASZIP)

    @property
    def in_full_chunks(self) -> int:
        """Number of points in chunks that are full."""
        return self.header.point_count - self.header.point_count % lazrs.LazVlr(self.packing).chunk_size()

    def chunks(self, points: int) -> Iterator[tuple[int, bytes]]:
        """The chunks with the first points, compressed, and the number of points of each."""
        packer = lazrs.LazVlr(self.packing)
        with self.path.open("rb") as source:
            source.seek(self.header.offset_to_point_data)
            sizes = [size for _, size in lazrs.read_chunk_table(source, packer)]
            source.seek(self.header.offset_to_point_data + _PLACE.size)
            for first, size in zip(range(0, points, packer.chunk_size()), sizes, strict=False):
                yield min(packer.chunk_size(), points - first), source.read(size)


def write_joined_cloud(paths: list[Path], path: Path, scratch: Path) -> None:
    """The points of all files, which have the same fields, system and offsets. Raises OSError."""
    parts = [_opened(one) for one in paths]
    header = _joined([part.header for part in parts])
    rest = _rest(parts, scratch / "rest.laz")
    packer = lazrs.LazVlr(rest.packing)
    header.vlrs = [*(one for one in header.vlrs if one.user_id != _LASZIP), LasZipVlr(rest.packing)]
    header.are_points_compressed = True
    with path.open("w+b") as target:
        header.write_to(target)
        points_at = target.tell()
        target.write(_PLACE.pack(0))
        table = [_added(target, *chunk) for part in parts for chunk in part.chunks(part.in_full_chunks)]
        table += [_added(target, *chunk) for chunk in rest.chunks(rest.header.point_count)]
        table_at = target.tell()
        lazrs.write_chunk_table(target, table, packer)
        target.seek(points_at)
        target.write(_PLACE.pack(table_at))


def _opened(path: Path) -> _CloudPart:
    with laspy.open(path) as reader:
        return _CloudPart(path, reader.header)


def _added(target: BinaryIO, points: int, chunk: bytes) -> tuple[int, int]:
    """Points and bytes of a chunk, which is written."""
    return points, target.write(chunk)


def _rest(parts: list[_CloudPart], path: Path) -> _CloudPart:
    """The points that are in no full chunk, in a file of their own."""
    blank = _copy(parts[0].header)
    with laspy.open(path, "w", header=blank, do_compress=True, laz_backend=laspy.LazBackend.Lazrs) as target:
        for part in parts:
            if number := part.header.point_count - part.in_full_chunks:
                with laspy.open(part.path, laz_backend=laspy.LazBackend.Lazrs) as reader:
                    reader.seek(part.in_full_chunks)
                    target.write_points(reader.read_points(number))
    return _opened(path)


def _joined(headers: list[laspy.LasHeader]) -> laspy.LasHeader:
    """The header of all points: number and extent of those of the parts that have some."""
    filled = [one for one in headers if one.point_count] or headers[:1]
    joined = _copy(filled[0])
    joined.mins, joined.maxs = np.min([one.mins for one in filled], axis=0), np.max([one.maxs for one in filled], axis=0)
    joined.point_count = sum(one.point_count for one in filled)
    joined.number_of_points_by_return = np.sum([one.number_of_points_by_return for one in filled], axis=0)
    return joined


def _copy(header: laspy.LasHeader) -> laspy.LasHeader:
    """The header of points of the same kind, without any."""
    copied = laspy.LasHeader(version=header.version, point_format=header.point_format)
    copied.generating_software, copied.system_identifier = header.generating_software, header.system_identifier
    copied.creation_date, copied.scales, copied.offsets = header.creation_date, header.scales, header.offsets
    copied.global_encoding, copied.vlrs = header.global_encoding, [one for one in header.vlrs if one.user_id != _LASZIP]
    return copied
