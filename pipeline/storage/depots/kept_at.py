"""Which depot holds the results of a run: its folder, unless a note in it names a prefix of an object store.

The note is written by `orthomill run --store` and holds an address, no keys; by it every later command finds the results.
"""

from pathlib import Path

from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import WorkflowError

NOTE = "store.txt"
RESULTS = ("rasters.zarr", "tables", "products")
"""folders of results"""


def depot_of(place: Path | Depot) -> Depot:
    """The depot of a run's folder. Raises WorkflowError, ResourceError where its object store cannot be used."""
    if not isinstance(place, Path):
        return place
    address = noted(place)
    if not address:
        return Folder(place)
    from orthomill.pipeline.storage.depots.bucket import bucket_of

    return bucket_of(address)


def noted(folder: Path) -> str:
    """The address of the object store that holds the results of a run; empty for those in its folder."""
    try:
        return (folder / NOTE).read_text(encoding="utf-8").strip()
    except (FileNotFoundError, NotADirectoryError):
        return ""


def keep_in(folder: Path, store: str) -> None:
    """From now on the results of a run are kept below `store`, in a prefix of the run's name. Raises OrthomillError."""
    from orthomill.pipeline.storage.depots.bucket import bucket_of

    address, before = f"{store.rstrip('/')}/{folder.name}", noted(folder)
    bucket_of(address).probe()
    if before == address:
        return
    if before or any((folder / part).is_dir() for part in RESULTS):
        where = f"in {before}" if before else "on this disk"
        raise WorkflowError(
            f"The results of {folder.name} are kept {where}; remove them first with 'orthomill clean {folder.name}', or leave "
            "--store out."
        )
    write_whole(folder / NOTE, f"{address}\n".encode())


def send_pages(folder: Path) -> None:
    """Put the pages that a run wrote into its folder beside its results, where those are kept elsewhere. Raises StoreError."""
    depot = depot_of(folder)
    if isinstance(depot, Folder):
        return
    for path in sorted(
        path for part in (folder, folder / "jobs") for path in part.glob("[!.]*") if path.is_file() and path.name != NOTE
    ):
        depot.send(path, path.relative_to(folder).as_posix())
