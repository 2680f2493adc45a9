"""`orthomill covariance`: points and photographs of a text file, and their covariances as JSON."""

import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError, WorkflowError
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.survey_files.photograph_names import PhotographNames


class CovarianceMethod(Protocol):
    """What the catalogue provides."""

    def of_photos(self, first: str, second: str) -> np.ndarray | None:
        """(6, 6), m and radians."""
        ...

    def rays(self, point: np.ndarray) -> Any:
        """What determines a point; None: too few photographs."""
        ...

    def of_points(self, first: Any, second: Any) -> np.ndarray | None:
        """(3, 3) m2."""
        ...


@dataclass(frozen=True)
class CovarianceTable:
    """The answer, the number of covariances in it, and a sentence for everything that is not known."""

    json: str
    count: int
    missed: tuple[str, ...]


def covariance_table(
    folder: Path, path: Path, sigma: float | None, method: Callable[[Block, float], CovarianceMethod]
) -> CovarianceTable:
    """The covariances of a run's points. Raises StoreError before it has a block, WorkflowError for a file that cannot be read."""
    store = Store(folder)
    if not store.has_table(BLOCK):
        raise StoreError(f"{folder.name} has no block yet; run it first: orthomill run {folder.name} --until orientation")
    block = store.table(BLOCK)
    points, photos = _read(path, block)
    known, missed, rows = method(block, sigma or block.sigma0_px), [], []
    rays = {name: known.rays(place) for name, place in points.items()}
    missed += [f"{name} is shown by fewer than two photographs with a covariance." for name, found in rays.items() if found is None]
    seen = [name for name, found in rays.items() if found is not None]
    for first, second in [*((n, n) for n in seen), *combinations(seen, 2)]:
        rows.append(_row(first, second, known.of_points(rays[first], rays[second]), "m2"))
    for first, second in [*((n, n) for n in photos), *combinations(photos, 2)]:
        rows.append(_row(first, second, known.of_photos(first, second), "X, Y, Z m; omega, phi, kappa rad"))
    missed += [
        f"{row['first']}, {row['second']}: not stored, for their photographs share no tie points."
        for row in rows
        if row["covariance"] is None
    ]
    return CovarianceTable(json.dumps({"covariances": rows}, indent=1), len(rows), tuple(missed))


def _row(first: str, second: str, covariance: np.ndarray | None, unit: str) -> dict[str, Any]:
    row: dict[str, Any] = {"first": first, "second": second, "unit": unit}
    if first == second and covariance is not None:
        row["sigma"] = [math.sqrt(max(value, 0.0)) for value in np.diag(covariance)]
    return {**row, "covariance": None if covariance is None else covariance.tolist()}


def _photo(word: str, block: Block) -> str:
    """The name in the block of a photograph that is called by its name or its file, in any case. Raises PhotoError."""
    name = PhotographNames(block.names).find(word) or word
    block.check_holds(name)
    return name


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _read(path: Path, block: Block) -> tuple[dict[str, np.ndarray], list[str]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise WorkflowError(f"The points {path} cannot be read; give a text file with name x y z on a line.") from error
    points: dict[str, np.ndarray] = {}
    photos: list[str] = []
    for number, line in enumerate(lines, start=1):
        words = [word for word in re.split(r"[,;\s]+", line.strip()) if word]
        if not words or words[0].startswith("#"):
            continue
        if len(words) == 1:
            photos.append(_photo(words[0], block))
            continue
        try:
            place = np.array([float(word) for word in words[-3:]])
        except ValueError:
            if number == 1 and not any(map(_is_number, words)):  # headings
                continue
            place = np.array([math.nan])
        if len(words) != 4 or not np.isfinite(place).all():
            raise WorkflowError(f"{path}, line {number}: '{line.strip()}' is neither name x y z nor the name of a photograph.")
        points[words[0]] = place
    if not (points or photos):
        raise WorkflowError(
            f"{path} holds neither points nor photographs; write name x y z, or the name of a photograph, on a line."
        )
    return points, photos
