"""Products of a run in the form that they had before: one file where sheets are, sheets where one file is, too many sheets.

They go when what replaces them is there, and not before.
"""

from collections.abc import Iterable, Iterator
from pathlib import PurePosixPath

from orthomill.pipeline.export.file_parts import COG_OF_PARTS, COG_OF_SHEETS
from orthomill.pipeline.records.records import Records
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.depots.folder import PRODUCTS
from orthomill.pipeline.storage.depots.product_files import SHEET_INDEX, other_form, sheet_folder
from orthomill.schemas.errors import some_of
from orthomill.schemas.job import Export


def drop_replaced(made: Iterable[Export], depot: Depot, records: Records) -> str:
    """Remove what the exports that are `made` replace; one sentence where a product has another form now, empty otherwise. Nobody
    else may run the project. Raises StoreError."""
    rasters = [one for one in made if one.format in ("cog", COG_OF_PARTS, COG_OF_SHEETS) and one.path.startswith(f"{PRODUCTS}/")]
    if not rasters:
        return ""
    files, folders = {name for name, _ in depot.entries(PRODUCTS)}, set(depot.folders(PRODUCTS))
    told = []
    for export in rasters:
        before = other_form(export.path)
        gone = tuple(_replaced(export, files, folders, depot))
        for name in gone:
            depot.delete(name)
        if PurePosixPath(before).name in files:
            told.append(f"{export.path} in place of {before}")
        if gone and export.format != COG_OF_SHEETS:
            depot.clear(sheet_folder(export.path))
        _forget(export.stage, set(gone), records)
    return f"Written in another form than before, by sheets_above, and the old files removed: {some_of(told, 5)}." if told else ""


def _replaced(export: Export, files: set[str], folders: set[str], depot: Depot) -> Iterator[str]:
    """Files that are no part of the product as it is now."""
    joined, sheets, before = export.format == COG_OF_SHEETS, sheet_folder(export.path), PurePosixPath(other_form(export.path))
    old = (before, before.with_suffix(".tfw")) if joined else (before,)
    yield from (path.as_posix() for path in old if path.name in files)
    if PurePosixPath(sheets).name in folders:
        kept = {*export.files, f"{sheets}/{SHEET_INDEX}"} if joined else set()
        yield from (path for name, _ in depot.entries(sheets) if (path := f"{sheets}/{name}") not in kept)


def _forget(stage: str, gone: set[str], records: Records) -> None:
    """What wrote files that are gone on purpose has left nothing, which nobody is to miss."""
    for record in records.of_stage(stage) if gone else ():
        if record.files and gone.issuperset(record.files):
            records.remove(record.key)
