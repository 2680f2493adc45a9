"""Removes the results of runs, and nothing else."""

import shutil
from pathlib import Path

from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.schemas.errors import StoreError


def clean_run(folder: Path, stages: tuple[str, ...]) -> None:
    """Remove the results of some stages, or with none named the run's folder.

    Raises StoreError when there is nothing or it cannot be removed, ResourceError while the project is being run.
    """
    if not folder.is_dir():
        raise StoreError(f"{folder} does not exist; there is nothing to clean.")
    # Every store of results is divided by stage, so that a stage can be removed without touching the others.
    parts = [folder / part / stage for stage in stages for part in ("rasters.zarr", "tables", "jobs")]
    # Under the lock: a run in progress would find its rasters and records gone between two jobs.
    with only_run(folder):
        if not isinstance(depot := depot_of(folder), Folder):
            for part in parts or [folder]:
                depot.clear(part.relative_to(folder).as_posix() if parts else "")
        for part in parts or [folder]:
            _remove(part)


def _remove(folder: Path) -> None:
    try:
        shutil.rmtree(folder)
    except FileNotFoundError:  # a stage that writes no rasters, or none yet
        return
    except OSError as error:
        raise StoreError(f"{folder} cannot be removed: {error.strerror}; make it writable.") from error
