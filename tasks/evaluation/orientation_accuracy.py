"""The oriented block against the true one: differences, and their ratios to the reported standard errors."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import INTERIOR, padded
from orthomill.schemas.orientation import Block
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.view import block_view


@dataclass(frozen=True)
class PhotoDifference:
    """Block minus truth of one photograph: centre (3,) m, rotation (3,) degrees, and standard errors (6,) m and degrees, NaN where
    not known."""

    photo: str
    centre: np.ndarray
    rotation: np.ndarray
    sigma: np.ndarray

    @property
    def ratios(self) -> np.ndarray:
        """(6,) differences over their standard errors."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.concatenate([self.centre, self.rotation]) / self.sigma


@dataclass(frozen=True)
class InteriorDifference:
    """One interior parameter of one camera: block, truth and standard error (NaN where it was fixed or is not known)."""

    camera: str
    parameter: str
    block: float
    truth: float
    sigma: float


def _sigmas(covariance: tuple[tuple[float, ...], ...] | None, count: int) -> np.ndarray:
    if covariance is None:
        return np.full(count, np.nan)
    # a variance of zero belongs to a fixed parameter: it has no ratio
    variance = np.diag(np.array(covariance, dtype=np.float64))
    return np.where(variance > 0, np.sqrt(np.abs(variance)), np.nan)


def photo_differences(block: Block, truth: Block) -> tuple[PhotoDifference, ...]:
    """One row per photograph in both blocks. Rotation differences are those of omega, phi and kappa, within +-180 degrees."""
    rows = []
    for photo in block.photos:
        if photo.photo not in truth.names:
            continue
        true = truth.of(photo.photo)
        # through the matrix: the same rotation can be written with different angles
        given, wanted = (np.array(angles(rotation_matrix(*np.radians(p.omega_phi_kappa)))) for p in (photo, true))
        rotation = np.degrees((given - wanted + np.pi) % (2 * np.pi) - np.pi)
        sigma = _sigmas(photo.covariance, 6)
        sigma[3:] = np.degrees(sigma[3:])
        rows.append(PhotoDifference(photo.photo, np.subtract(photo.centre, true.centre), rotation, sigma))
    return tuple(rows)


def interior_differences(block: Block, truth: Block) -> tuple[InteriorDifference, ...]:
    """A row for each parameter that the lens has; cameras correspond by the photographs they took."""
    # by photographs, not by name: a block may name its cameras after EXIF, the truth after the simulation
    rows: list[InteriorDifference] = []
    seen: set[str] = set()
    for name in block.names:
        key = block.of_photo[name]
        if key in seen or name not in truth.of_photo:
            continue
        seen.add(key)
        mine, true = block.cameras[key], truth.camera_of(name)
        sigma = _sigmas(padded(mine.covariance) if mine.covariance else None, len(INTERIOR))
        values = zip(INTERIOR, mine.interior, true.interior, sigma, strict=True)
        rows += [InteriorDifference(key, *value) for value in values if value[0] in mine.parameters]
    return tuple(rows)


def datum_shifts(block: Block, truth: Block, points: np.ndarray) -> np.ndarray:
    """How far (N, 2) m, east and north, the block's orientations move ground points (N, 3): mean over photographs that show one.

    A point is projected with the true orientation and brought back to its height with the adjusted one. NaN where none shows it.
    """
    total, count = np.zeros((len(points), 2)), np.zeros(len(points))
    for name in sorted(set(block.names) & set(truth.names)):
        true, adjusted = block_view(truth, name), block_view(block, name)
        pixels = true.project(points)
        shown = true.contains(pixels)
        total[shown] += (adjusted.at_height(pixels[shown], points[shown, 2]) - points[shown])[:, :2]
        count += shown
    with np.errstate(invalid="ignore"):
        return total / np.where(count, count, np.nan)[:, None]


def datum_heights(block: Block, truth: Block, points: np.ndarray) -> np.ndarray:
    """How much (N,) m the block's orientations raise ground points (N, 3): rays of their true pixels, intersected as adjusted.

    Every photograph that contains a point counts; NaN where fewer than two do.
    """
    normal, right, count = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3)), np.zeros(len(points))
    for name in sorted(set(block.names) & set(truth.names)):
        true, adjusted = block_view(truth, name), block_view(block, name)
        pixels = true.project(points)
        shown = true.contains(pixels)
        rays = adjusted.rays(pixels[shown])
        # The part of a vector that is perpendicular to the ray: what is minimised is the distance from all rays.
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        normal[shown] += across
        right[shown] += np.einsum("nij,nj->ni", across, adjusted.centre - points[shown])
        count += shown
    raised = np.full(len(points), np.nan)
    seen = count >= 2
    raised[seen] = np.linalg.solve(normal[seen], right[seen][..., None])[:, 2, 0]
    return raised
