"""The acceptance of a delivery as a document by itself, made to be printed and signed."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

from orthomill.pipeline.report.page_template import page_template
from orthomill.pipeline.signing.statement import digest_of_bytes
from orthomill.schemas.accuracy.acceptance import AcceptanceResult
from orthomill.schemas.accuracy.acceptance_record import AcceptedFile
from orthomill.schemas.accuracy.accuracy_statement import AccuracyKind
from orthomill.schemas.accuracy.point_tests import PointTest

PROFILES = {
    "asprs_2023": "ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (2023)",
    "adv_truedop": "AdV, product standard of digital orthophotos (DOP20, TrueDOP)",
    "inspire_oi": "INSPIRE, data specification on orthoimagery (D2.8.II.3)",
    "custom": "limits agreed with the client",
}
"""titles of the profiles; their settings have the same names"""
_KINDS: dict[AccuracyKind, str] = {
    "horizontal": "in plan",
    "nva": "in height, open ground",
    "vva": "in height, under vegetation",
    "nva_terrain": "bare ground, open",
    "vva_terrain": "bare ground, under vegetation",
    "three_dimensional": "plan and height",
}


@dataclass(frozen=True)
class _PointRow:
    """A check point as a line of the document: differences m, None where they were not tested; `notes` says why not."""

    name: str
    plan: tuple[float, float] | None
    height: float | None
    ground: float | None
    notes: str


@dataclass(frozen=True)
class _FileRow:
    """A file, or a folder of `count` files, whose digests are in the data alone."""

    path: str
    size: int
    sha256: str
    count: int = 1


def acceptance_json(result: AcceptanceResult) -> bytes:
    """The acceptance as data: the same bytes for the same result."""
    return result.model_dump_json(indent=1).encode()


def acceptance_page(result: AcceptanceResult) -> str:
    """The document, without network; it names the digest of its data."""
    record = result.record
    return page_template("acceptance.html").render(
        result=result,
        record=record,
        title=PROFILES.get(result.profile, result.profile),
        kinds=_KINDS,
        digest=digest_of_bytes(acceptance_json(result)).sha256,
        rows=tuple(map(_point_row, record.points)) if record else (),
        delivered=tuple(_file_rows(record.files)) if record else (),
    )


def _point_row(point: PointTest) -> _PointRow:
    notes = ["under vegetation"] if point.vegetated else []
    for what, test in (("height", point.height), ("ground", point.terrain), ("place", point.place)):
        notes += [f"{what}: {test.reason}"] if test and not test.tested else []
    return _PointRow(point.name, point.place_difference, point.height_difference, point.difference(point.terrain), "; ".join(notes))


def _file_rows(files: tuple[AcceptedFile, ...]) -> Iterator[_FileRow]:
    """Files one by one, and those of a folder below the first one as one line."""
    for folder, found in groupby(sorted(files, key=lambda file: (_folder(file.path), file.path)), lambda file: _folder(file.path)):
        inside = tuple(found)
        if folder:
            yield _FileRow(f"{folder}/", sum(file.size for file in inside), "", len(inside))
        else:
            yield from (_FileRow(file.path, file.size, file.sha256) for file in inside)


def _folder(path: str) -> str:
    """products/colmap of products/colmap/0/points3D.bin; empty for products/dsm.tif and dsm.tif."""
    return "/".join(path.split("/")[:2]) if path.count("/") > 1 else ""
