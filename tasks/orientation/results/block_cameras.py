"""The cameras of an adjusted block, and their covariances with each other and with the photographs.

Where the interior orientation varies from photograph to photograph, every photograph has a camera of its own: the sum of what all
photographs of the camera share and of its own corrections. All later stages take it as any other camera.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.orientation import JointCovariance
from orthomill.tasks.adjustment.model.collinearity import photo_interiors
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.orientation.block.assembly import BlockResults
from orthomill.tasks.orientation.measurements import with_interior


@dataclass(frozen=True, eq=False)
class BlockCamera:
    """A camera of the tables: as it was given, its `interior` (17,), the columns (17,) of the unknowns that make it up (-1: none)
    in `parts` that add up, and the `photos` that have it."""

    name: str
    given: Camera
    interior: np.ndarray
    parts: tuple[np.ndarray, ...]
    photos: tuple[int, ...]

    @property
    def adjusted(self) -> bool:
        """Whether any of its parameters is an unknown."""
        return any(bool((part >= 0).any()) for part in self.parts)


def block_cameras(results: BlockResults) -> tuple[BlockCamera, ...]:
    """The cameras of the photographs of the block, by name."""
    found = _varying(results) if len(results.result.network.variation) else _shared(results)
    return tuple(sorted(found, key=lambda camera: camera.name))


def _shared(results: BlockResults) -> Iterator[BlockCamera]:
    problem, result = results.problem, results.result
    for k, columns in enumerate(result.network.interior_columns):
        photos = tuple(map(int, np.flatnonzero(problem.camera_of == k)))
        if photos:
            yield BlockCamera(problem.camera_names[k], problem.cameras[k], result.state.interior[k], (columns,), photos)


def _varying(results: BlockResults) -> Iterator[BlockCamera]:
    problem, network = results.problem, results.result.network
    interior, _ = photo_interiors(results.result.state, problem.camera_of)
    for i, k in enumerate(problem.camera_of):
        own = np.full(len(INTERIOR), -1)
        own[network.variation.parameters] = network.variation_columns[i]
        name = f"{problem.camera_names[k]}, {problem.names[i]}"
        yield BlockCamera(name, problem.cameras[k], interior[i], (network.interior_columns[k], own), (i,))


def camera_tables(result: Adjustment, cameras: tuple[BlockCamera, ...]) -> dict[str, Camera]:
    """The cameras with adjusted values and covariances; those that were fixed as given."""
    return {camera.name: _adjusted(result, camera) if camera.adjusted else camera.given for camera in cameras}


def _adjusted(result: Adjustment, camera: BlockCamera) -> Camera:
    covariance = _between(result, camera.parts, camera.parts)
    changed = {"name": camera.name, "source": "block", "sigma0": result.sigma0_px, "covariance": rows_of(covariance)}
    return with_interior(camera.given, camera.interior).model_copy(update=changed)


def with_photograph(result: Adjustment, photo: int, camera: BlockCamera) -> np.ndarray:
    """(6, 17) the covariance of the unknowns of a photograph with the interior orientation of a camera."""
    return _between(result, (6 * photo + np.arange(6),), camera.parts)


def joint_cameras(
    result: Adjustment, cameras: tuple[BlockCamera, ...], related: set[tuple[int, int]]
) -> tuple[JointCovariance, ...]:
    """The covariance between the interior orientations of every two cameras that were adjusted; of cameras of single photographs,
    only where these are `related` by common points."""
    return tuple(
        JointCovariance(first=a.name, second=b.name, covariance=rows_of(_between(result, a.parts, b.parts)))
        for a, b in combinations([camera for camera in cameras if camera.adjusted], 2)
        if len(a.parts) == 1 or are_related(a.photos, b.photos, related)
    )


def are_related(some: tuple[int, ...], others: tuple[int, ...], related: set[tuple[int, int]]) -> bool:
    """Whether any two photographs of two cameras are the same or share points."""
    return any(a == b or (min(a, b), max(a, b)) in related for a in some for b in others)


def _between(result: Adjustment, rows: tuple[np.ndarray, ...], columns: tuple[np.ndarray, ...]) -> np.ndarray:
    """The covariance of two sums of unknowns, given by the columns of their parts; 0 where there is none (-1)."""
    pairs = [result.cofactor.joint(np.concatenate([a, b]))[: len(a), len(a) :] for a in rows for b in columns]
    return np.asarray(np.sum(pairs, axis=0))


def rows_of(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """A matrix as tables hold it."""
    return tuple(tuple(map(float, row)) for row in matrix)
