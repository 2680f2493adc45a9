"""Cloud-optimised point clouds: LAZ whose chunks are the nodes of an octree, with a table of them for readers.

The file: header of LAS 1.4, the record `info` first among its variable records, that of LASzip with chunks of any size, the points,
the table of chunks, and the hierarchy as an extended record, on one page.

Source: COPC 1.0 (copc.io), ASPRS LAS 1.4 R15.
"""

import struct
import tempfile
from pathlib import Path
from typing import BinaryIO

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import LasZipVlr
from laspy.vlrs.vlr import VLR

from orthomill.pipeline.export.clouds.cloud_source import CloudSource, as_points, nothing_there
from orthomill.pipeline.export.clouds.point_octree import SPAN_BITS, NodeKey, PointOctree
from orthomill.schemas.errors import WorkflowError

_INFO, _ENTRY = struct.Struct("<5d2Q2d11Q"), struct.Struct("<4iQ2i")
_EXTENDED = struct.Struct("<H16sHQ32s")
"""head of an extended variable record"""
_CHUNK_OFFSET = 8
"""bytes between the begin of the point data and the first chunk: the place of the table of chunks"""


def write_copc(path: Path, source: CloudSource) -> None:
    """The points as a file at `path`. Raises WorkflowError where there are none, or where the system has degrees."""
    header = source.header
    check_metric(header)
    with tempfile.TemporaryDirectory(dir=path.parent, suffix=".part") as scratch, path.open("w+b") as target:
        tree = PointOctree(source.parts(), Path(scratch))
        if not tree.count:
            raise nothing_there()
        packer = lazrs.LazVlr.new_for_compression(header.point_format.id, header.point_format.num_extra_bytes, True)
        info = VLR("copc", 1, "COPC info", bytes(_INFO.size))
        header.vlrs = [info, LasZipVlr(packer.record_data()), *header.vlrs]
        header.are_points_compressed = True
        header.write_to(target)
        points_at = target.tell()
        keys = _write_nodes(target, tree, header, packer)
        table_at = target.seek(0, 2)
        pages = _entries(target, keys, packer, points_at)
        target.seek(table_at)
        target.write(_EXTENDED.pack(0, b"copc", 1000, len(pages), b"EPT hierarchy") + pages)
        info.record_data = _info(tree, header, table_at + _EXTENDED.size, len(pages))
        header.start_of_first_evlr, header.number_of_evlrs = table_at, 1
        target.seek(0)
        header.write_to(target, ensure_same_size=True)


def check_metric(header: laspy.LasHeader) -> None:
    """Raises WorkflowError where coordinates are degrees: the cubes of an octree would be none."""
    if len(set(header.scales.tolist())) > 1:
        raise WorkflowError("An octree of points needs a system in metres; give another --crs, or --as laz.")


def _write_nodes(target: BinaryIO, tree: PointOctree, header: laspy.LasHeader, packer: lazrs.LazVlr) -> list[tuple[NodeKey, int]]:
    """Writes a chunk for every node; keys and numbers of points in their order."""
    written: list[tuple[NodeKey, int]] = []
    compressor = lazrs.LasZipCompressor(target, packer)
    for key, records in tree.nodes():
        # The last chunk is finished by `done`, which would otherwise write an empty one.
        if written:
            compressor.finish_current_chunk()
        compressor.compress_many(np.frombuffer(records.tobytes(), np.uint8))
        header.grow(as_points(header, records))
        written.append((key, len(records)))
    compressor.done()
    return written


def _entries(target: BinaryIO, keys: list[tuple[NodeKey, int]], packer: lazrs.LazVlr, points_at: int) -> bytes:
    """The page of the hierarchy: where the chunk of each node is."""
    target.seek(points_at)
    chunks = lazrs.read_chunk_table(target, packer)
    at, entries = points_at + _CHUNK_OFFSET, []
    for (key, count), (points, size) in zip(keys, chunks, strict=True):
        assert points == count, (points, count)
        entries.append((key, _ENTRY.pack(*key, at, size, count)))
        at += size
    return b"".join(entry for _, entry in sorted(entries))


def _info(tree: PointOctree, header: laspy.LasHeader, page_at: int, page_size: int) -> bytes:
    half = 2.0 ** (tree.cube.bits - 1) * header.scales[0]
    centre = header.offsets + tree.cube.low * header.scales + half
    spacing = 2 * half / (1 << SPAN_BITS)
    return _INFO.pack(*centre.tolist(), half, spacing, page_at, page_size, 0.0, 0.0, *(0,) * 11)
