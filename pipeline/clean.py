"""Removes what runs left behind, and nothing else."""

import shutil
from pathlib import Path

from schemas.errors import StoreError


def clean_run(folder: Path, stages: tuple[str, ...] | None) -> None:
    """Remove a run's folder, or only the results of some stages. Raises StoreError."""
    try:
        if stages is None:
            shutil.rmtree(folder)
            return
        for stage in stages:
            for part in ("rasters.zarr", "tables", "jobs"):
                shutil.rmtree(folder / part / stage, ignore_errors=True)
    except FileNotFoundError:
        raise StoreError(f"{folder} does not exist; there is nothing to clean.") from None
    except OSError as error:
        raise StoreError(f"{folder} cannot be removed: {error.strerror}.") from error
