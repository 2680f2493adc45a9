"""Sub-pixel refinement: every observation of a track is matched by least squares against the track's reference photograph.

Patches of the two photographs are arranged in mosaics, with gaps that no window and no smoothing can cross, and matched in one
call. The affine transformation starts from the difference of the SIFT directions and the ratio of the SIFT sizes; where a point
contradicts the median of its pair by more than 25 degrees or a factor of 1.4 (two directions at one place), the median is used.

Where the matching fails, the observation keeps its SIFT position with a correspondingly larger standard error, or is dropped: a
setting.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.imagery.pyramid import level_to_full
from orthomill.tasks.matching.gaussian_reach import reach_of
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import match_points
from orthomill.tasks.tie_points.match_records import Observations, Refined, RefinedPair, RefinedPairs, Scatters, Values
from orthomill.tasks.tie_points.pair_matching import epipolar_scatter
from orthomill.tasks.tie_points.patches import chosen_patches, nearest_pixels

_BATCH = 1024  # patches of a mosaic: about 3 MB with patches of 55 px, which fit the cache
# SIFT repeats directions to some degrees and sizes to a tenth; beyond these limits it found another peak of its histogram or
# another scale, and least-squares matching would start outside its radius of convergence.
_DIRECTION_LIMIT, _SIZE_LIMIT = np.radians(25.0), np.log(1.4)
# A patch must hold the window rotated by 45 degrees (root of 2) and enlarged by a quarter.
_ENLARGEMENT = 1.75
_COLUMNS = ("photo", "track", "col", "row", "sigma", "outcome")


@dataclass(frozen=True)
class PatchRules:
    """How the patches of a photograph are matched: at which pyramid level and in strips of which height they were extracted."""

    level: int
    tile: int
    matching: LeastSquaresMatching

    @property
    def half(self) -> int:
        """Half side of a patch."""
        return int(np.ceil(_ENLARGEMENT * self.matching.reach + self.matching.max_shift + 2))

    def patches(self, strips: tuple[Values, ...], observations: Observations, rows: np.ndarray) -> np.ndarray:
        """The patches of the observations `rows` of the photograph, from those of its strips."""
        return chosen_patches(strips, observations, rows, self.level, self.tile, self.half)

    @property
    def gap(self) -> int:
        """px between the patches of a mosaic: smoothing one must not reach the next."""
        return reach_of(self.matching.smoothing) + 1


@dataclass(frozen=True)
class Refinable:
    """A photograph by its number and name; how its patches are matched, and in how many strips they were cut."""

    number: int
    name: str
    rules: PatchRules
    strips: int


def refine_pairs(
    own: Observations,
    own_patches: tuple[Values, ...],
    observations: Iterator[Observations],
    patches: Iterator[Values],
    cameras: Cameras,
    photo: Refinable,
    partners: tuple[Refinable, ...],
) -> RefinedPairs:
    """`refine_pair` of a photograph with each of its `partners`, whose observations and strips of patches follow each other.

    A block has ten times as many pairs as photographs, and most pairs share a few points only: reading the patches of a photograph
    again for each of them took longer than matching.
    """
    found = [
        refine_pair(
            (own, next(observations)),
            own_patches,
            tuple(islice(patches, partner.strips)),
            cameras,
            (photo.number, partner.number),
            (photo.name, partner.name),
            (photo.rules, partner.rules),
        )
        for partner in partners
    ]
    return RefinedPairs(_joined([pair.refined for pair in found]), Scatters(pairs=tuple(pair.scatter for pair in found)))


def _joined(parts: list[Refined]) -> Refined:
    return Refined(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS})


def refine_pair(
    observations: tuple[Observations, Observations],
    left_patches: tuple[Values, ...],
    right_patches: tuple[Values, ...],
    cameras: Cameras,
    photos: tuple[int, int],
    names: tuple[str, str],
    rules: tuple[PatchRules, PatchRules],
) -> RefinedPair:
    """Refined observations of either photograph whose track's reference is the other one, and their scatter about epipolar lines.

    photos, names: numbers and names of the two; left_patches, right_patches: all strips of either.
    """
    strips = left_patches, right_patches
    parts, ends = [], []
    for reference, other in ((0, 1), (1, 0)):
        shared = _shared(observations[reference], observations[other], photos[reference])
        sides = tuple(zip((reference, other), shared, strict=True))
        chosen = [observations[side].take(rows) for side, rows in sides]
        cut = [rules[side].patches(strips[side], observations[side], rows) for side, rows in sides]
        parts.append(
            refined_observations((chosen[0], chosen[1]), (cut[0], cut[1]), photos[other], (rules[reference], rules[other]))
        )
        ends.append(_left_and_right(chosen[0], parts[-1], reference))
    points = np.concatenate([end[0] for end in ends]), np.concatenate([end[1] for end in ends])
    return RefinedPair(_joined(parts), epipolar_scatter(points, (cameras.of(names[0]), cameras.of(names[1]))))


def _left_and_right(reference: Observations, refined: Refined, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Matched points (M, 2) px in the left and the right photograph; `side` is 0 when the left one is the reference, else 1."""
    good = refined.outcome == int(Outcome.CONVERGED)
    ends = [np.column_stack([table.col[good], table.row[good]]) for table in (reference, refined)]
    return (ends[0], ends[1]) if side == 0 else (ends[1], ends[0])


def _shared(reference: Observations, other: Observations, photo: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of both tables with the same track, for tracks whose reference is `photo`."""
    _, left, right = np.intersect1d(reference.track, other.track, assume_unique=True, return_indices=True)
    own = reference.reference[left] == photo
    return left[own], right[own]


def refined_observations(
    observations: tuple[Observations, Observations],
    patches: tuple[np.ndarray, np.ndarray],
    photo: int,
    rules: tuple[PatchRules, PatchRules],
) -> Refined:
    """Match N patches (N, side, side) of the reference with those of another photograph, row by row.

    observations: of both, row by row the same tracks; photo: number of the other one.
    """
    affine = start_affine(*observations) * 2.0 ** (rules[0].level - rules[1].level)
    count = len(affine)
    found = [_match_batch(observations, patches, affine, slice(start, start + _BATCH), rules) for start in range(0, count, _BATCH)]
    col, row, sigma, outcome = (np.concatenate([part[n] for part in found]) if found else np.empty(0) for n in range(4))
    return Refined(
        photo=np.full(count, photo, dtype=np.int32),
        track=observations[1].track,
        col=col.astype(np.float64),
        row=row.astype(np.float64),
        sigma=sigma.astype(np.float32),
        outcome=outcome.astype(np.uint8),
    )


def start_affine(reference: Observations, other: Observations) -> np.ndarray:
    """(N, 4) d other / d reference, col and row by col and row, from sizes and directions of the features."""
    turn = np.radians(other.angle.astype(np.float64) - reference.angle)
    # Logarithms, so that a point twice and one half the size of its partner are equally far from equality.
    log_scale = np.log(other.size.astype(np.float64) / reference.size)
    common_turn = _median_direction(turn)
    common_scale = np.median(log_scale) if len(log_scale) else 0.0
    outlying = np.abs(_wrapped(turn - common_turn)) > _DIRECTION_LIMIT
    turn = np.where(outlying, common_turn, turn)
    log_scale = np.where(np.abs(log_scale - common_scale) > _SIZE_LIMIT, common_scale, log_scale)
    cos, sin = np.exp(log_scale) * np.cos(turn), np.exp(log_scale) * np.sin(turn)
    return np.column_stack([cos, -sin, sin, cos])


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return np.arctan2(np.sin(angle), np.cos(angle))


def _median_direction(turn: np.ndarray) -> float:
    """Median of angles about their densest direction, so that a minority of opposite ones has no influence."""
    if not len(turn):
        return 0.0
    # Bins of 10 degrees, summed over three: a peak at the border of two bins is not missed.
    counts, edges = np.histogram(_wrapped(turn), bins=36, range=(-np.pi, np.pi))
    smooth = counts + np.roll(counts, 1) + np.roll(counts, -1)
    centre = edges[int(smooth.argmax())] + np.pi / 36
    return float(centre + np.median(_wrapped(turn - centre)[np.abs(_wrapped(turn - centre)) < np.pi / 4]))


def _match_batch(
    observations: tuple[Observations, Observations],
    patches: tuple[np.ndarray, np.ndarray],
    affine: np.ndarray,
    part: slice,
    rules: tuple[PatchRules, PatchRules],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """col, row (px of the full photograph), sigma (px), outcome."""
    (mosaic, origins), (other_mosaic, _) = (_mosaic(stack[part], rules[0].gap) for stack in patches)
    rows = np.arange(len(affine))[part]
    (positions, centres), (other_positions, other_centres) = (
        nearest_pixels(table.take(rows), rule.level) for table, rule in zip(observations, rules, strict=True)
    )
    points, starts = origins + rules[0].half + positions - centres, origins + rules[1].half + other_positions - other_centres
    found = match_points(mosaic, other_mosaic, points, starts, rules[0].matching, affine[part])
    shift = found.position - starts
    full = level_to_full(other_positions + shift, rules[1].level)
    # One number per observation: the adjustment weights both coordinates alike.
    sigma = np.sqrt((found.sigma_col**2 + found.sigma_row**2) / 2) * 2 ** rules[1].level
    return full[:, 0], full[:, 1], sigma, found.outcome


def _mosaic(patches: np.ndarray, gap: int) -> tuple[np.ndarray, np.ndarray]:
    """Patches (N, side, side) in one image with gaps of no data (0), and the (col, row) of their first pixels (N, 2)."""
    count, side = patches.shape[:2]
    pitch, columns = side + gap, max(1, int(np.ceil(np.sqrt(count))))
    rows = -(-count // columns)
    tiles = np.zeros((rows * columns, pitch, pitch), dtype=np.uint8)
    tiles[:count, :side, :side] = patches
    mosaic = tiles.reshape(rows, columns, pitch, pitch).swapaxes(1, 2).reshape(rows * pitch, columns * pitch)
    number = np.arange(count)
    return mosaic, np.column_stack([number % columns, number // columns]).astype(np.float64) * pitch
