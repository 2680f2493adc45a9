"""Which file is a raster product of a run: a GeoTIFF, or above a bound a virtual raster (VRT) that joins its sheets.

Stages, reports and people call it products/ortho.tif. Where it is in sheets, products/ortho.vrt opens as one image, and the sheets,
a GeoTIFF each, lie in products/ortho_sheets. Whoever opens, lists or names a product asks here which of the two is there.
"""

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.depots.folder import PRODUCTS
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.stage_report import StageReport

WHOLE, JOINED = ".tif", ".vrt"
"""how the names of products end that are one file, and of those that join sheets"""
SHEETS = "_sheets"
"""how the names of folders of sheets end, here and of those that `orthomill export --sheets` makes"""
SHEET_INDEX = "sheets.gpkg"
"""in such a folder: the outlines of its sheets"""
_NAMED = re.compile(rf"{PRODUCTS}/[\w.-]+?\{WHOLE}\b")
"""a product that is named in a text"""
_SHEET = r"\d+-\d+\.tif"
_TAGS = frozenset(
    [
        "VRTDataset",
        "SRS",
        "GeoTransform",
        "Metadata",
        "MDI",
        "VRTRasterBand",
        "Description",
        "NoDataValue",
        "UnitType",
        "ColorInterp",
        "SimpleSource",
        "SourceFilename",
        "SourceBand",
        "SourceProperties",
        "SrcRect",
        "DstRect",
    ]
)
"""what a virtual raster of ours consists of"""
_TIFF = (b"II*\0", b"II+\0")
"""how GeoTIFFs begin, classic and big"""


def joined_path(path: str) -> str:
    """The virtual raster that a product is when it is in sheets: products/ortho.vrt of products/ortho.tif."""
    return f"{path.removesuffix(WHOLE)}{JOINED}"


def other_form(path: str) -> str:
    """The file that a raster product is in its other form: of one file what joins sheets, and the other way round."""
    return f"{path.removesuffix(JOINED)}{WHOLE}" if path.endswith(JOINED) else joined_path(path)


def sheet_folder(path: str) -> str:
    """The folder of its sheets, of either name of a product."""
    return f"{PurePosixPath(path).with_suffix('')}{SHEETS}"


def raster_products(names: Iterable[str]) -> dict[str, str]:
    """Raster products by what people call them, of the names of files that lie in products/: ortho -> ortho.tif or ortho.vrt."""
    # Where a run was stopped while it exchanged one for the other, both are there; the whole one was finished.
    rasters = sorted((name for name in names if name.endswith((WHOLE, JOINED))), key=lambda name: (name.endswith(WHOLE), name))
    return {PurePosixPath(name).stem: name for name in rasters}


def product_files(run: Path) -> dict[str, Path]:
    """The files of all raster products in a run's folder."""
    folder = run / PRODUCTS
    found = raster_products(os.listdir(folder)) if folder.is_dir() else {}
    return {name: folder / file for name, file in sorted(found.items())}


def product_file(run: Path, name: str) -> Path | None:
    """The file of a raster product such as "ortho" in a run's folder; None where there is none."""
    return product_files(run).get(name)


def in_sheets(names: Iterable[str]) -> dict[str, str]:
    """products/ortho.tif -> products/ortho.vrt of every product in sheets, of the names of files that lie in products/."""
    joined = (name for name in raster_products(names).values() if name.endswith(JOINED))
    return {f"{PRODUCTS}/{PurePosixPath(name).stem}{WHOLE}": f"{PRODUCTS}/{name}" for name in joined}


def as_they_lie(report: StageReport, names: Iterable[str]) -> StageReport:
    """A report that names products as they are, with the names of the files that lie in products/: stages know none of sheets."""
    joined = in_sheets(names)
    return StageReport.model_validate(_renamed(report.model_dump(), joined)) if joined else report


def _renamed(value: Any, joined: Mapping[str, str]) -> Any:
    if isinstance(value, dict):
        return {name: _renamed(part, joined) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [_renamed(part, joined) for part in value]
    # A topic is a text as well, and stays what it is.
    return _NAMED.sub(lambda name: joined.get(name[0], name[0]), value) if type(value) is str else value


def product_size(depot: Depot, path: str) -> int | None:
    """Bytes of a product, with its sheets where it joins some; None where it is not there."""
    size = depot.size(path)
    return size if size is None or not path.endswith(JOINED) else size + (depot.size(sheet_folder(path)) or 0)


def refuse_joined(path: str) -> None:
    """Raises WorkflowError for sheets as input of a run: what joins them stays the same file when they change."""
    if path.endswith(JOINED):
        raise WorkflowError(
            f"{path} joins sheets, and a run would not see when these change; make one GeoTIFF of it (orthomill export PROJECT "
            "--as geotiff --of NAME) and name that."
        )


def joins_own_sheets(path: Path) -> bool:
    """Whether a file is a virtual raster as runs write them, of nothing but the GeoTIFFs beside it: another one could read any
    file of this machine. Raises OSError."""
    if path.suffix != JOINED:
        return False
    folder, text = sheet_folder(path.name), path.read_text(encoding="utf-8", errors="replace")
    sources = set(re.findall(r'<SourceFilename relativeToVRT="1">([^<]*)</SourceFilename>', text))
    plain = set(re.findall(r"<(\w+)", text)) <= _TAGS and "<!" not in text and "subClass" not in text
    own = all(re.fullmatch(rf"{re.escape(folder)}/{_SHEET}", source) for source in sources)
    named = len(re.findall("<SourceFilename", text)) == len(re.findall('<SourceFilename relativeToVRT="1">', text))
    return plain and own and named and all(_is_geotiff(path.parent / source) for source in sources)


def _is_geotiff(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(4) in _TIFF
