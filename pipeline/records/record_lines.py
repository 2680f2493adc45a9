"""The lines in which records are kept: appended one by one, each with a checksum of its own, read without being understood.

A line is `CHECKSUM <tab> STATUS <tab> STARTED <tab> ROW <tab> COL <tab> ITEM <tab> RECORD`. Which of several lines about a job
counts is seen from its head; what it says is read from JSON when somebody asks. A line that is cut or damaged is no line.
"""

import json
import zlib
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

Place = tuple[str, int, int]
"""(item, row, column) of a job in its stage"""
# Of two workers that did the same job in one run, one may have been killed in the middle: what the other left is whole, since both
# wrote the same bytes.
STATUSES = ("removed", "damaged", "failed", "done")
"""in the order in which they count within a run"""
_HEAD = 6
"""fields before the record"""


class RecordLine(NamedTuple):
    """A record, not yet understood. The larger of two about the same job counts."""

    wave: int
    """number of the run that wrote it"""
    rank: int
    """of its status"""
    started: float
    text: bytes
    """the record as JSON; empty for a job whose results are about to be touched"""


def line_of(place: Place, status: str, started: float, text: bytes) -> bytes:
    """A line, with its end. The JSON of a record has no tab and no line break in it."""
    item, row, col = place
    rest = b"\t".join((status.encode(), repr(started).encode(), b"%d" % row, b"%d" % col, json.dumps(item).encode(), text))
    return b"%08x\t%b\n" % (zlib.crc32(rest), rest)


@lru_cache(maxsize=1024)
def _item(text: bytes) -> str:
    # Thousands of tiles have one name between them, which is read and kept once.
    return str(json.loads(text.decode()))


def read_lines(content: bytes, wave: int) -> Iterator[tuple[Place, RecordLine] | None]:
    """What the whole lines of a file say; None for one that is damaged."""
    for line in content.split(b"\n")[:-1]:
        checksum, _, rest = line.partition(b"\t")
        if checksum != b"%08x" % zlib.crc32(rest):
            yield None
            continue
        status, started, row, col, item, text = rest.split(b"\t", _HEAD - 1)
        yield (_item(item), int(row), int(col)), RecordLine(wave, STATUSES.index(status.decode()), float(started), text)
