"""The relative orientation of every pair of photographs that shares tie points: the first check of the matches, and the start of
the block."""

import numpy as np
from scipy.sparse import csr_array
from scipy.special import gammaln

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import TiePoints
from orthomill.schemas.orientation import RelativeOrientation, RelativeOrientations
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.measurements import ideal, on_a_line, tie_rays
from orthomill.tasks.orientation.relative.pure_rotation import PureRotation, pure_rotation
from orthomill.tasks.orientation.relative.relative_orientation import Relative, epipolar_distance, model_points, orient_robust
from orthomill.tasks.orientation.relative.start_distortion import start_distortion
from orthomill.tasks.orientation.sensor_frame import Upright

NO_PARALLAX = 0.9
"""A pair has no base where a pure rotation explains this share of the matches that a relative orientation explains. Not all of
them, because the two further unknowns of a base always fit some wrong matches, too."""

LEAST_SEEN, FARTHEST_SEEN = 8, 10.0
"""Least number of matches whose distortion can be inverted, and how far out their ideal points may lie, in camera constants: the
iteration that inverts a folding distortion diverges to points far outside of any frame."""
ON_LINE = 3.0
"""Matches within so many standard errors of one line of a frame leave the rotation about it undetermined."""
APART = 3.0
"""Positions that lie so many standard errors apart are not of one place."""
OWN = 0.4
"""Share of a stated standard error that is not common to the positions of a flight"""
CHANCE = -3.0
"""log10 of the expected number of chance agreements: below it, fewer than one in a thousand blocks of wrong matches."""
FOLDED = (
    "the distortion of the camera cannot be undone at nearly all of the {2} matches of {0} and {1}; it is that of another camera, "
    "or its camera constant is far too short."
)


NARROW = (
    "the {2} matches of {0} and {1} lie on one line in {3}, which leaves the relative orientation undetermined; tie points all "
    "over the frame are needed."
)
LEAST_KEPT = 8
"""Three more than the unknowns: fewer agreeing matches say nothing."""


def relate_pairs(photos: Photos, cameras: Cameras, tie_points: TiePoints, least: int) -> RelativeOrientations:
    """The relative orientations of all pairs that share `least` tie points or more, those with most kept matches first, in the
    frames of the sensors. Nominal cameras whose lens distortion prevents a fit get an approximate k1, returned with the pairs."""
    upright = Upright(photos, cameras)
    if upright.anything:
        photos, cameras, tie_points = upright.sensor_photos(), upright.sensor_cameras(), upright.sensor_ties(tie_points)
    names = photos.names
    number = {name: i for i, name in enumerate(names)}
    # The coordinates from the image centre are those of any interior orientation; ideal ones are not.
    rays, _ = tie_rays(photos, cameras, tie_points)
    of_photo = rows_of_photos(rays.photo, len(names))
    pairs = [(names[i], names[j]) for i, j in sharing_pairs(rays, len(names), least)]

    def relate(own: Cameras, chosen: list[tuple[str, str]]) -> list[RelativeOrientation]:
        coordinates = ideal_coordinates(photos, own, rays)
        found = []
        for pair in chosen:
            left, right = (of_photo[number[name]] for name in pair)
            apart = _apart(photos[pair[0]], photos[pair[1]])
            found.append(_relate(pair, own, rays, coordinates, common_rays(rays, left, right), apart))
        return found

    found = relate(cameras, pairs)
    distorted = start_distortion(cameras, found, relate)
    if distorted.k1:
        found = relate(distorted.cameras, pairs)
    return RelativeOrientations(pairs=tuple(sorted(found, key=lambda pair: -pair.kept)), start_k1=distorted.k1)


def no_pairs() -> RelativeOrientations:
    """The table of a block whose pairs are not oriented: its exterior orientation is read from a file."""
    return RelativeOrientations()


def ideal_coordinates(photos: Photos, cameras: Cameras, rays: Rays) -> np.ndarray:
    """Ideal image coordinates (M, 2) of rays, in units of c."""
    out = np.empty_like(rays.xy)
    for name, own in zip(photos.names, rows_of_photos(rays.photo, len(photos.names)), strict=True):
        # In units of c, because the two photographs of a pair may come from cameras of different size.
        out[own] = ideal(cameras.of(name), rays.xy[own])
    return out


def sharing_pairs(rays: Rays, photos: int, least: int) -> list[tuple[int, int]]:
    """Pairs of photo numbers (left < right) with `least` common points or more."""
    # Photographs x points as a sparse matrix: its product with itself counts the common points of all pairs at once.
    seen = csr_array((np.ones(len(rays), np.int32), (rays.photo, rays.point)), shape=(photos, int(rays.point.max(initial=-1)) + 1))
    common = (seen @ seen.T).tocoo()
    return sorted(
        (int(i), int(j)) for i, j, count in zip(common.row, common.col, common.data, strict=True) if i < j and count >= least
    )


def common_rays(rays: Rays, left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the rays of all points that two photographs share, in the same order; `left`, `right`: indices of the rays of
    each."""
    # A point has one ray in a photograph at most.
    _, i, j = np.intersect1d(rays.point[left], rays.point[right], assume_unique=True, return_indices=True)
    return left[i], right[j]


def _apart(left: Photo, right: Photo) -> float | None:
    """m: how far apart two photographs were taken by their positions, where these say that they were not taken from one place."""
    if left.position is None or right.position is None or left.position_sigma is None or right.position_sigma is None:
        return None
    away = float(np.linalg.norm(np.subtract(left.position, right.position)))
    own = OWN if (left.flight, left.serial) == (right.flight, right.serial) else 1.0
    return away if away > APART * own * float(np.linalg.norm([left.position_sigma, right.position_sigma])) else None


def _relate(
    names: tuple[str, str],
    cameras: Cameras,
    rays: Rays,
    coordinates: np.ndarray,
    common: tuple[np.ndarray, np.ndarray],
    apart: float | None,
) -> RelativeOrientation:
    """The relative orientation of one pair by its `common` rays, or the row that says why there is none."""
    a, b = common
    shared = len(a)
    seen = (np.abs(np.hstack([coordinates[a], coordinates[b]])) < FARTHEST_SEEN).all(axis=1)
    a, b = a[seen], b[seen]
    if len(a) < LEAST_SEEN:
        return _failed(names, shared, FOLDED.format(*names, shared))
    c_left, c_right = (cameras.of(name).c for name in names)
    observations = np.hstack([coordinates[a] * c_left, coordinates[b] * c_right])
    # Not below a pixel: what a nominal camera leaves of its lens distortion is of that size, however sharp the tie points are.
    expected = max(1.0, float(np.median(rays.sigma[a])))
    narrow = next((n for n, xy in zip(names, np.hsplit(observations, 2), strict=True) if on_a_line(xy, ON_LINE * expected)), None)
    if narrow:
        return _failed(names, len(a), NARROW.format(*names, len(a), narrow))
    rotated = pure_rotation(observations, c_left, c_right, 3.0 * expected)
    try:
        relative = orient_robust(observations, c_left, c_right, expected)
    except GeometryError as error:
        # Matches of a pure rotation leave the base undetermined, which makes the relative orientation fail, too.
        return (
            _failed(names, len(a), str(error)) if rotated.kept.sum() < LEAST_KEPT else _without_base(names, rotated, len(a), apart)
        )
    if rotated.kept.sum() >= max(LEAST_KEPT, NO_PARALLAX * relative.kept.sum()):
        return _without_base(names, rotated, len(a), apart)
    return _row(names, relative, observations, cameras.of(names[1]))


def _failed(names: tuple[str, str], matches: int, outcome: str) -> RelativeOrientation:
    """The row of a pair without a relative orientation."""
    return RelativeOrientation(left=names[0], right=names[1], matches=matches, kept=0, outcome=outcome)


def _without_base(names: tuple[str, str], rotated: PureRotation, matches: int, apart: float | None) -> RelativeOrientation:
    """The row of a pair whose rays do not intersect: the same photograph twice, or a camera that only rotated; or one that moved by
    `apart` m, of which too few matches in too small a part of the frame show nothing."""
    kept = int(rotated.kept.sum())
    if rotated.same:
        where = f"{kept} tie points have the same pixel coordinates in both"
        outcome = f"{names[1]} is the same photograph as {names[0]} ({where}); leave one of them out."
    elif apart is not None:
        outcome = (
            f"{kept} of {matches} matches of {names[0]} and {names[1]} fit a rotation of the camera alone, although their "
            f"positions lie {apart:.0f} m apart: the matches are too few, or in too small a part of the frame, to show the "
            "parallax. Larger copies of the photographs, or more overlap, give more of them."
        )
    else:
        outcome = (
            f"{kept} of {matches} matches of {names[0]} and {names[1]} show no parallax, as if both were taken from one place "
            "(pure rotation), so they give no points on the ground. Photographs from other places, or tie points over more of the "
            "frame, are needed."
        )
    turn = tuple(float(v) for v in np.degrees(angles(rotated.rotation)))
    return RelativeOrientation(
        left=names[0], right=names[1], matches=matches, kept=kept, outcome=outcome, omega_phi_kappa=turn, same_photo=rotated.same
    )


def chance_agreement(relative: Relative, observations: np.ndarray, camera: Camera) -> float:
    """log10 of the expected number of relative orientations that would fit as many matches as closely if all matches were random.

    Source: Moisan and Stival 2004, the a contrario test of epipolar geometry.
    """
    # A random point lies within the band of the epipolar line with the ratio of the areas of band and frame; five matches determine
    # the orientation and agree with it anyway.
    count, kept = len(observations), int(relative.kept.sum())
    # Distances are per coordinate of four; across the line in one image the same discrepancy is larger by sqrt(2).
    distance = np.sqrt(2.0) * max(float(epipolar_distance(relative.solution.model, observations[relative.kept]).max()), 0.1)
    band = min(2.0 * distance * np.hypot(camera.width, camera.height) / (camera.width * camera.height), 1.0)
    choices = np.log(max(count - 5, 1)) + _log_choose(count, kept) + _log_choose(kept, 5)
    return float((choices + (kept - 5) * np.log(band)) / np.log(10.0))


def _log_choose(n: int, k: int) -> float:
    """Natural logarithm of the binomial coefficient: the coefficient itself overflows for thousands of matches."""
    return float(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1))


def _row(names: tuple[str, str], relative: Relative, observations: np.ndarray, camera: Camera) -> RelativeOrientation:
    """The row of a pair with a relative orientation, unless its agreement may be chance."""
    solution, model = relative.solution, relative.solution.model
    kept, base = int(relative.kept.sum()), model.base
    # The median: a few points near infinity, or next to the base, say nothing about the geometry of the pair.
    intersection = float(np.degrees(np.median(model_points(model, observations[relative.kept])[1])))
    outcome = (
        "oriented"
        if kept >= LEAST_KEPT and chance_agreement(relative, observations, camera) < CHANCE
        else f"Only {kept} of {len(observations)} matches agree with one relative orientation, which may be chance."
    )
    return RelativeOrientation(
        left=names[0],
        right=names[1],
        matches=len(observations),
        kept=kept,
        outcome=outcome,
        base=tuple(map(float, base)),
        omega_phi_kappa=tuple(float(v) for v in np.degrees(angles(model.rotation))),
        sigma=tuple(float(v) for v in np.degrees(solution.standard_errors)) if solution.redundancy else None,
        by_bz=(float(base[1] / base[0]), float(base[2] / base[0])) if abs(base[0]) > 0.7 else None,
        sigma0_px=float(solution.sigma0) if solution.redundancy else None,
        intersection_deg=intersection,
    )
