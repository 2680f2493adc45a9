"""Radiometric balance of the block: gain, offset and vignetting per photograph and channel, from the ground that photos share.

Model: the grey value of photo i at a point of ground brightness G is  g = gain_i (1 + v1 r^2 + v2 r^4) G + offset_i,  with r from
the photo's middle in half diagonals. The ground brightness of every sample is unknown too; it is eliminated point by point, as in a
bundle adjustment, so that noise in g does not bias the gains. Huber weights limit the influence of vehicles, leaves and
reflections. Absolute brightness is not determinable: the gains have the mean 1 and the offsets the mean 0.

Source: the least-squares form of what Petsa et al. 2007 did by equating histograms (sources/blending.md, M19).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.colouring.balance.photo_radiometry import PhotoRadiometry, Radiometry, corrected
from orthomill.tasks.colouring.balance.shared_ground import Samples, grouped, pair_differences, usable_samples

TERMS = 4
"""gain, gain v1, gain v2, offset"""
HUBER = 1.5
ROUNDS = 12
# Standard errors of the prior: of gain, gain v1, gain v2 (shares) and offset (grey levels). Exposures within a flight hardly differ
# by more; a term that is not estimated gets a prior that fixes it, so that the normal equations keep one shape.
_PRIOR_SIGMA = (0.1, 0.1, 0.1, 10.0)
_FIXED_SIGMA = 1e-6
TOGETHER = 50.0
"""Samples of a photograph that err together and count as one: a photograph that lies beside its place shows other ground in all of
them, and by their number alone it would be given any gain"""
_LEAST_SIGMA = 0.1  # grey levels: simulated photographs may fit exactly, and weights must stay finite
_DATUM_WEIGHT = 1e3  # per observation: the two datum equations hold to a thousandth of their share
_CONVERGED = 1e-5  # largest change of a parameter: of a gain, or of an offset in grey levels
_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class _Channel:
    """Observations of one channel: photo, point and r2 of each grey value g (N,); rows of a point follow each other."""

    photo: np.ndarray
    point: np.ndarray
    r2: np.ndarray
    g: np.ndarray
    photos: int
    points: int

    @cached_property
    def first(self) -> np.ndarray:
        """(points + 1,) the first row of every point, and the number of rows."""
        return np.searchsorted(self.point, np.arange(self.points + 1))

    @cached_property
    def seen_together(self) -> np.ndarray:
        """bool (photos, photos): both see a point."""
        found = np.zeros((self.photos, self.photos), np.bool_)
        _mark_pairs(self.first, self.photo, found)
        return found


@njit()
def _mark_pairs(first, photo, found):
    """Marks in `found` (photos, photos) who sees a point together; first (points + 1,): first row of each point, photo (N,)."""
    for p in range(first.size - 1):
        for k in range(first[p], first[p + 1]):
            for m in range(first[p], first[p + 1]):
                found[photo[k], photo[m]] = True


def _prior(photos: int, vignetting: bool) -> tuple[np.ndarray, np.ndarray]:
    """Expected values and weights (of grey values whose variance is 1) of the 4 parameters of all photos.

    Small beside samples that fit: only a photo without overlap, or whose samples fit no better than by chance, is kept near gain 1
    and offset 0 by them.
    """
    sigma = np.array(_PRIOR_SIGMA)
    if not vignetting:
        sigma[1:3] = _FIXED_SIGMA
    return np.tile([1.0, 0.0, 0.0, 0.0], photos), np.tile(sigma**-2.0, photos)


def _datum(photos: int) -> np.ndarray:
    """(2, 4 photos): the sum of the gains and the sum of the offsets."""
    # Gains and offsets are free together: G -> a G + b changes no grey value when all gains and offsets follow.
    rows = np.zeros((2, photos, TERMS))
    rows[0, :, 0] = rows[1, :, 3] = 1.0
    return rows.reshape(2, -1)


def _solved(normal: sparse.csc_matrix, right: np.ndarray, datum: np.ndarray, hard: float) -> np.ndarray:
    """The solution of (normal + hard datum.T datum) x = right, where two rows of the datum (2, N) touch every unknown.

    Added to the normal equations they would fill them, and time would grow with the cube of the photographs: 8.7 CPU-s a round of
    1024 instead of 0.3.
    Source: the matrix inversion lemma (Woodbury 1950).
    """
    # The normal equations are symmetric, and their diagonal is large enough to be the pivots.
    factors = splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    free, moved = factors.solve(right), factors.solve(datum.T.copy())
    return np.asarray(free - moved @ np.linalg.solve(np.eye(2) / hard + datum @ moved, datum @ free))


class _Reduced(NamedTuple):
    """Normal equations after elimination of the ground: `normal` dx = `right`, then dG = (`ground_right` - `coupling` dx) /
    `ground_normal`, where `coupling` (N, 4) has for each row its point's coupling with its photo; `variance` of a grey value, whose
    weight is 1."""

    normal: sparse.bsr_matrix
    right: np.ndarray
    coupling: np.ndarray
    ground_normal: np.ndarray
    ground_right: np.ndarray
    variance: float


def _reduced(channel: _Channel, ground: np.ndarray, x: np.ndarray) -> _Reduced:
    """The normal equations of one iteration, linearised at the ground brightness and the parameters `x` (4 photos,)."""
    slope, residual = np.empty(len(channel.g)), np.empty(len(channel.g))
    _compare(channel.first, channel.photo, channel.r2, channel.g, ground, x.reshape(-1, TERMS), slope, residual)
    sigma = max(_MAD_TO_SIGMA * float(np.median(np.abs(residual))), _LEAST_SIGMA)
    weight = np.minimum(1.0, HUBER * sigma / np.maximum(np.abs(residual), 1e-12))
    rows, cols = np.nonzero(channel.seen_together)
    place = np.zeros(channel.seen_together.shape, np.int64)
    place[rows, cols] = np.arange(len(rows))
    blocks, right = np.zeros((len(rows), TERMS, TERMS)), np.zeros((channel.photos, TERMS))
    sums = _NormalSums(blocks, right, np.empty((len(weight), TERMS)), np.zeros(channel.points), np.zeros(channel.points))
    _add_points(channel.first, channel.photo, channel.r2, ground, _RowFit(slope, residual, weight), place, sums)
    size = channel.photos * TERMS
    pointers = np.searchsorted(rows, np.arange(channel.photos + 1))
    normal = sparse.bsr_matrix((blocks, cols, pointers), shape=(size, size))
    return _Reduced(normal, right.ravel(), sums.coupling, sums.ground_normal, sums.ground_right, sigma**2)


class _RowFit(NamedTuple):
    """Of each row (N,): derivative of its grey value by the ground's brightness, residual, weight."""

    slope: np.ndarray
    residual: np.ndarray
    weight: np.ndarray


class _NormalSums(NamedTuple):
    """The arrays of `_Reduced` for the kernel, which fills them: blocks of pairs of photos, right side (photos, 4)."""

    blocks: np.ndarray
    right: np.ndarray
    coupling: np.ndarray
    ground_normal: np.ndarray
    ground_right: np.ndarray


@njit()
def _compare(first, photo, r2, g, ground, a, slope, residual):
    """Fills slope and residual (N,) at the parameters a (photos, 4)."""
    for p in range(first.size - 1):
        for k in range(first[p], first[p + 1]):
            own = a[photo[k]]
            slope[k] = own[0] + r2[k] * (own[1] + r2[k] * own[2])
            residual[k] = g[k] - slope[k] * ground[p] - own[3]


@njit()
def _add_points(first, photo, r2, ground, fit, place, sums):
    """Adds the normal equations of all points, each without its brightness; place (photos, photos): number of a pair's block."""
    design = np.empty(TERMS)
    for p in range(first.size - 1):
        # The ground's own block is diagonal, for every sample has one brightness: it is eliminated point by point.
        for k in range(first[p], first[p + 1]):
            sums.ground_normal[p] += fit.weight[k] * fit.slope[k] ** 2
            sums.ground_right[p] += fit.weight[k] * fit.slope[k] * fit.residual[k]
        share, level = 1.0 / sums.ground_normal[p], sums.ground_right[p] / sums.ground_normal[p]
        for k in range(first[p], first[p + 1]):
            # The products gain v1 and gain v2 are the unknowns, in which the model is linear.
            design[0], design[1], design[2], design[3] = ground[p], r2[k] * ground[p], r2[k] ** 2 * ground[p], 1.0
            own, right, weight = sums.blocks[place[photo[k], photo[k]]], sums.right[photo[k]], fit.weight[k]
            for i in range(TERMS):
                sums.coupling[k, i] = weight * fit.slope[k] * design[i]
                right[i] += weight * fit.residual[k] * design[i] - level * sums.coupling[k, i]
                for j in range(TERMS):
                    own[i, j] += weight * design[i] * design[j]
        for k in range(first[p], first[p + 1]):
            for m in range(first[p], first[p + 1]):
                block = sums.blocks[place[photo[k], photo[m]]]
                for i in range(TERMS):
                    for j in range(TERMS):
                        block[i, j] -= sums.coupling[k, i] * sums.coupling[m, j] * share


def _solve_channel(channel: _Channel, vignetting: bool) -> np.ndarray:
    """Parameters (photos, 4): gain, gain v1, gain v2, offset. Gauss-Newton with the ground eliminated."""
    expected, weights = _prior(channel.photos, vignetting)
    datum, x = _datum(channel.photos), expected.copy()
    ground = np.bincount(channel.point, channel.g, channel.points) / np.bincount(channel.point, minlength=channel.points)
    hard = _DATUM_WEIGHT * len(channel.g)
    for _ in range(ROUNDS):
        found = _reduced(channel, ground, x)
        prior = found.variance * TOGETHER * weights
        right = found.right + prior * (expected - x)
        # Without the datum a darker ground under larger gains fits as well: the equations would be singular but for the prior.
        right = right + hard * (datum.T @ (datum @ (expected - x)))
        dx = _solved(sparse.csc_matrix(found.normal + sparse.diags_array(prior)), right, datum, hard)
        x += dx
        moved = (found.coupling * dx.reshape(-1, TERMS)[channel.photo]).sum(axis=1)
        ground += (found.ground_right - np.bincount(channel.point, moved, channel.points)) / found.ground_normal
        if np.abs(dx).max() < _CONVERGED:
            break
    return x.reshape(-1, TERMS)


def _photos(names: tuple[str, ...], parameters: np.ndarray, counts: np.ndarray) -> tuple[PhotoRadiometry, ...]:
    """From the adjusted parameters (3, photos, 4)."""
    gain, v1, v2 = parameters[..., 0], parameters[..., 1] / parameters[..., 0], parameters[..., 2] / parameters[..., 0]
    return tuple(
        PhotoRadiometry(
            photo=name,
            gain=tuple(gain[:, i]),
            v1=tuple(v1[:, i]),
            v2=tuple(v2[:, i]),
            offset=tuple(parameters[:, i, 3]),
            samples=int(counts[i]),
        )
        for i, name in enumerate(names)
    )


def _all_corrected(photo: np.ndarray, grey: np.ndarray, r2: np.ndarray, photos: tuple[PhotoRadiometry, ...]) -> np.ndarray:
    """Grey values (N, bands) of samples, each corrected by its own photo."""
    after = np.empty_like(grey)
    for i, one in enumerate(photos):
        mine = photo == i
        after[mine] = corrected(grey[mine], r2[mine], one)
    return after


def balance_block(names: tuple[str, ...], samples: Samples, white: float, vignetting: bool) -> Radiometry:
    """Adjusts the radiometry of all photos together.

    `names` in the order of `Samples.photo`; `white` is the greatest grey value of the photos' dtype (255 or the stretch of 16
    bits). Without shared ground every photo keeps gain 1 and offset 0.
    """
    samples = usable_samples(samples, 0.0, white)
    if not len(samples):
        return Radiometry(photos=tuple(PhotoRadiometry(photo=name) for name in names), white=white)
    samples = samples.take(np.argsort(samples.point, kind="stable"))
    # Solved in grey levels of 8 bits, in which the prior and the thresholds are stated; offsets are scaled back.
    unit = white / 255.0
    point, points = grouped(samples.point)
    grey, r2 = samples.grey / unit, samples.r2.astype(np.float64)
    channels = (_Channel(samples.photo, point, r2, grey[:, band], len(names), points) for band in range(3))
    solved = np.array([_solve_channel(channel, vignetting) for channel in channels])
    photos = _photos(names, solved, np.bincount(samples.photo, minlength=len(names)))
    differences = pair_differences(point, _all_corrected(samples.photo, grey, r2, photos))
    return Radiometry(
        photos=tuple(p.model_copy(update={"offset": tuple(o * unit for o in p.offset)}) for p in photos),
        white=white,
        samples=len(samples),
        points=points,
        difference_before=float(pair_differences(point, grey).mean()),
        difference_after=float(differences.mean()),
        difference_median_after=float(np.median(differences)),
    )
