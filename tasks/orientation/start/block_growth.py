"""Incremental orientation of a block: intersect points, resect the photograph that sees most of them, intersect again, adjust.

Tolerances are wide while starting values are approximate, and a robust bundle adjustment follows whenever the block has grown by a
third. A block grows from the relative orientation of one pair, or from approximate exterior orientations of many photographs.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import RelativeOrientation
from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.network import Interior, Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import spread
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.measurements import ideal, on_a_line, with_interior
from orthomill.tasks.orientation.relative.relative_orientation import FLIP
from orthomill.tasks.orientation.start.pair_joining import LEAST_AGREEING, base_lengths, by_pairs, spread_lengths
from orthomill.tasks.orientation.start.point_consensus import LEAST, PointRays, consensus

LEAST_ANGLE = np.radians(1.5)
"""Points whose rays differ by less are not used while the block grows: the relative error of their depth is the error of a
direction over this angle, a tenth for 0.15 degrees, which starting values easily have."""
LEAST_POINTS = 8
"""A resection needs three points; eight leave a redundancy with which a wrong position is recognised."""
GROWN = 1.34
"""A bundle adjustment follows when the block has grown by a third: adjusting after every photograph costs the square of their
number, adjusting later lets the shape drift until further photographs do not fit."""
ROUGH = (64.0, 16.0, 4.0, 2.0)
"""Factors of the tolerances while given orientations are refined, from coarse to fine."""
LEAST_SHARE = 0.5
"""A given start is refused where a smaller share of the measurements fits in the end."""
STRANGE_START = (
    "The tie points contradict the exterior orientation that was given as a start: hardly any of them intersect. It may belong to "
    "other photographs or use another convention of angles; leave it out, and the photographs are oriented from their tie points."
)
GROWTH_PARAMETERS = np.array(INTERIOR) == "k1"
"""Only radial distortion is adjusted while a free block grows: over flat ground, c and flying height are fully correlated."""


@dataclass(frozen=True, eq=False)
class GrowthMaterial:
    """The input of the start. `cameras` in the order of `interior`; `camera_of` (P,) numbers; `relative` orientations by
    `names`."""

    names: tuple[str, ...]
    camera_names: tuple[str, ...]
    cameras: list[Camera]
    camera_of: np.ndarray
    interior: Interior
    rays: Rays
    points: int
    relative: tuple[RelativeOrientation, ...]


@dataclass(frozen=True, eq=False)
class Given:
    """Approximate exterior orientations: `rotation` (P, 3, 3), `centre` (P, 3) local m, of the photographs `known` (P,) bool."""

    rotation: np.ndarray
    centre: np.ndarray
    known: np.ndarray


class BlockGrowth:
    """The state of a growing block: orientation of the placed photographs, known points, rays that are not rejected."""

    def __init__(self, material: GrowthMaterial, free: np.ndarray):
        photos = len(material.names)
        self.material, self.rays, self.free = material, material.rays, free
        self.state = State(
            np.tile(np.eye(3), (photos, 1, 1)),
            np.zeros((photos, 3)),
            np.zeros((material.points, 3)),
            material.interior.value.copy(),
            np.zeros(3),
            lens=material.interior.lens,
        )
        self.placed = np.zeros(photos, bool)
        self.known = np.zeros(material.points, bool)
        self.good = np.ones(len(self.rays), bool)
        self.attempts: dict[int, str] = {}
        self.of_photo = rows_of_photos(self.rays.photo, photos)
        self.first = self.rays.first(material.points)
        self.refresh()

    def refresh(self) -> None:
        """Recomputes the ideal coordinates (M, 2), in units of c, with the current interior orientations."""
        self.ideal = np.empty_like(self.rays.xy)
        for k, camera in enumerate(self.material.cameras):
            own = self.material.camera_of[self.rays.photo] == k
            self.ideal[own] = ideal(with_interior(camera, self.state.interior[k]), self.rays.xy[own])
        # A new distortion may fold where the old one did not; such rays have no direction any more.
        self.good &= self.seen

    @property
    def seen(self) -> np.ndarray:
        """(M,) bool: rays for which the current distortion can be inverted."""
        return np.isfinite(self.ideal).all(axis=1)

    def tolerance(self, index: np.ndarray) -> np.ndarray:
        """(m,) px: rays at `index` with larger residuals are rejected while starting values are approximate."""
        return np.maximum(4.0, 8.0 * self.rays.sigma[index]) * self.slack

    def beside(self, photo: int) -> np.ndarray:
        """Ascending indices of all rays of the points that a photograph sees."""
        point = self.rays.point[self.of_photo[photo]]
        low, count = self.first[point], np.diff(self.first)[point]
        return np.repeat(low - np.cumsum(count) + count, count) + np.arange(count.sum())

    def supported(self, index: np.ndarray) -> np.ndarray:
        """(P,) how many of the rays at `index` every photograph has to known points."""
        own = index[self.good[index] & self.known[self.rays.point[index]]]
        return np.bincount(self.rays.photo[own], minlength=len(self.placed))

    @property
    def believed(self) -> np.ndarray:
        """(M,) bool: rays that agree with a known point."""
        return np.asarray(self.good & self.known[self.rays.point])

    slack = 2.0

    def place(self, photo: int, rotation: np.ndarray, centre: np.ndarray) -> None:
        """Take a photograph into the block: rotation (3, 3), centre (3,)."""
        self.state.rotation[photo], self.state.centre[photo] = rotation, centre
        self.placed[photo] = True

    def misfit(self, index: np.ndarray) -> np.ndarray:
        """(m,) px: lengths of the residuals of the rays at `index`."""
        return np.linalg.norm(residuals(self.state, self.rays.take(index), self.material.camera_of), axis=1)

    def triangulate(self, among: np.ndarray | None = None) -> None:
        """Intersects the points that are not known yet and that two or more placed photographs see; `among`: ascending indices of
        all rays of some points (None: all points), where nothing has changed for the others.

        A point with three or more rays may lose its worst one, three times at most: a wrong match spoils the point, not the rays.
        """
        among = np.arange(len(self.rays)) if among is None else among
        for _ in range(3):
            index = among[self.good[among] & self.placed[self.rays.photo[among]] & ~self.known[self.rays.point[among]]]
            # `own`: for every ray the row of its point among those that are intersected.
            point, own, count = np.unique(self.rays.point[index], return_inverse=True, return_counts=True)
            index, point = index[count[own] >= 2], point[count >= 2]
            if not len(index):
                return
            _, own, count = np.unique(self.rays.point[index], return_inverse=True, return_counts=True)
            places, wide = self._intersect(index, own)
            self.state.point[point[wide]] = places[wide]
            misfit = self.misfit(index) / self.tolerance(index)
            # The largest residual of each point; with two rays it cannot be said which of them is wrong, so both stay.
            worst = np.zeros(len(point))
            np.maximum.at(worst, own, misfit)
            self.known[point[wide & (worst < 1.0)]] = True
            lose = (misfit == worst[own]) & (misfit >= 1.0) & (count[own] >= 3) & wide[own]
            if not lose.any():
                return
            self.good[index[lose]] = False

    def reconcile(self) -> None:
        """Points that lost rays get the largest set of rays that meet, where it is larger than the one that they have."""
        seen = self.seen & self.placed[self.rays.photo]
        lost = np.bincount(self.rays.point[seen & ~self.good], minlength=len(self.known)) > 0
        index = np.flatnonzero(seen & lost[self.rays.point])
        if not len(index):
            return
        points, first = np.unique(self.rays.point[index], return_index=True)
        place, count, agree = consensus(self._point_rays(index, np.append(first, len(index))))
        have = np.bincount(self.rays.point[index[self.good[index]]], minlength=len(self.known))[points]
        better = count > np.where(self.known[points], have, LEAST - 1)
        own = better[np.searchsorted(points, self.rays.point[index])]
        self.good[index[own]] = agree[own]
        self.state.point[points[better]] = place[better]
        self.known[points[better]] = True

    def _point_rays(self, index: np.ndarray, first: np.ndarray) -> PointRays:
        photo = self.rays.photo[index]
        c = self.state.interior[self.material.camera_of[photo], 0]
        return PointRays(
            first=first,
            origin=self.state.centre[photo],
            direction=self._directions(index),
            rotation=self.state.rotation,
            photo=photo,
            ideal=self.ideal[index],
            tolerance=self.tolerance(index) / c,
        )

    def _directions(self, index: np.ndarray) -> np.ndarray:
        """(m, 3) unit vectors of the rays at `index` in the system of the block."""
        directions = np.einsum("ni,nij->nj", self._inward(index), self.state.rotation[self.rays.photo[index]])
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def _inward(self, index: np.ndarray) -> np.ndarray:
        """(m, 3) directions of the rays at `index` in their image systems."""
        return np.column_stack([self.ideal[index], -np.ones(len(index))])

    def _intersect(self, index: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) nearest to the rays at `index`, and (n,) bool: their rays intersect at LEAST_ANGLE or more; `own` (m,): the
        number of each ray's point, 0 to n - 1."""
        photo, count = self.rays.photo[index], int(own.max(initial=-1)) + 1
        # Points nearest to their rays in space, and not in the image: the bundle adjustment follows, and this needs no start.
        directions = self._directions(index)
        projector = np.eye(3) - directions[:, :, None] * directions[:, None, :]
        normal, right, mean = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((count, 3))
        np.add.at(normal, own, projector)
        np.add.at(right, own, np.einsum("nij,nj->ni", projector, self.state.centre[photo]))
        np.add.at(mean, own, directions)
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
        # The angle to the mean direction is half of the angle between two rays; for many rays it finds the widest without all
        # pairs.
        off_axis = np.zeros(count)
        np.maximum.at(off_axis, own, np.arccos(np.clip((directions * mean[own]).sum(axis=1), -1, 1)))
        wide = off_axis > 0.5 * LEAST_ANGLE
        points = np.zeros_like(right)
        points[wide] = np.linalg.solve(normal[wide], right[wide][..., None])[..., 0]
        return points, wide

    def resect(self, photo: int) -> bool:
        """Resects a photograph from the known points that it sees: seeded P3P samples, then least squares on those that agree.

        Where this fails, `attempts` says why.
        """
        index = self.of_photo[photo]
        index = index[self.known[self.rays.point[index]] & self.good[index]]
        if len(index) < LEAST_POINTS:
            self.attempts[photo] = f"only {len(index)} of its tie points are known in the block; {LEAST_POINTS} are needed"
            return False
        c = self.state.interior[self.material.camera_of[photo], 0]
        pose = _resection(self.state.point[self.rays.point[index]], self.ideal[index], float(np.median(self.tolerance(index))) / c)
        refusal = self._refusal(index, None if pose is None else pose[2], c)
        if pose is None or refusal:
            self.attempts[photo] = refusal or ""
            return False
        self.place(photo, pose[0], pose[1])
        self.good[index[self.misfit(index) > self.tolerance(index)]] = False
        return True

    def join(self, photo: int) -> bool:
        """Places a photograph by its relative orientation to a placed one, where enough of its known points agree with that."""
        index = self.of_photo[photo]
        index = index[self.known[self.rays.point[index]] & self.good[index]]
        found = [(self._agreeing(photo, pose, index), pose) for pose in self._poses(photo, index)]
        agree, pose = max(found, key=lambda one: one[0].sum(), default=(np.zeros(0, bool), None))
        if pose is None or agree.sum() < max(LEAST_AGREEING, 0.5 * len(index)):
            return False
        self.place(photo, *pose)
        self.good[index[~agree]] = False
        return True

    def _poses(self, photo: int, index: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Rotations and centres of a photograph by its pairs, with lengths of the base that known rays at `index` give."""
        names, points = self.material.names, self.state.point[self.rays.point[index]]
        placed = {names[i]: (self.state.rotation[i], self.state.centre[i]) for i in np.flatnonzero(self.placed)}
        for ahead in by_pairs(names[photo], placed, self.material.relative):
            for length in spread_lengths(base_lengths(ahead, points, self._inward(index) @ ahead.rotation)):
                yield ahead.rotation, ahead.origin + length * ahead.direction

    def _agreeing(self, photo: int, pose: tuple[np.ndarray, np.ndarray], index: np.ndarray) -> np.ndarray:
        """(m,) bool: rays at `index` that agree with a rotation and centre of their photograph."""
        self.state.rotation[photo], self.state.centre[photo] = pose
        return np.asarray(self.misfit(index) <= self.tolerance(index))

    def _refusal(self, index: np.ndarray, agreeing: np.ndarray | None, c: float) -> str | None:
        """Why a resection from the rays at `index` is not accepted, of which those numbered `agreeing` agree with it; None if it
        is."""
        count = 0 if agreeing is None else len(agreeing)
        # A fifth of the points at least: random wrong matches agree on some position, too.
        if agreeing is None or count < max(LEAST_POINTS, 0.2 * len(index)):
            return f"{count} of its {len(index)} tie points with the block agree on one position, which is too few"
        agreed = index[agreeing]
        # Points on one line of the frame fit any rotation about this line.
        if on_a_line(c * self.ideal[agreed], float(np.median(self.tolerance(agreed)))):
            return (
                "its tie points with the block lie on one line of its frame, which leaves the rotation about this line "
                "undetermined; it needs tie points all over its frame"
            )
        return None

    def bundle(self) -> None:
        """A robust free adjustment of all placed photographs and known points; afterwards rays that do not fit are rejected, and
        points left with fewer than two rays are no longer known."""
        index = np.flatnonzero(self.good & self.placed[self.rays.photo] & self.known[self.rays.point])
        active = np.flatnonzero(self.placed)
        # The network numbers the placed photographs only: unplaced ones would leave singular blocks.
        number = np.full(len(self.placed), -1)
        number[active] = np.arange(len(active))
        rays = self.rays.take(index)
        rays = replace(rays, photo=number[rays.photo].astype(np.int32))
        sub = replace(self.state, rotation=self.state.rotation[active], centre=self.state.centre[active])
        # With three photographs or fewer, k1 takes up what is wrong in the starting values.
        network = _free_network(self.material, active, self.placed.sum() >= 4)
        # The robust limit follows the actual spread: stated standard errors do not hold while the block still bends.
        unit = max(spread(self.misfit(index) / rays.sigma), 0.5)
        sub, _ = minimise(network, sub, rays, 2.0 * unit, tolerance=1e-4)
        self.state.rotation[active], self.state.centre[active] = sub.rotation, sub.centre
        self.state = replace(self.state, point=sub.point, interior=sub.interior)
        self.refresh()
        self.forget(index)

    def expel(self) -> None:
        """Removes photographs that see too few known points."""
        self.placed &= self.supported(np.arange(len(self.rays))) >= LEAST_POINTS

    def forget(self, index: np.ndarray) -> None:
        """Rejects the rays at `index` that do not fit, and drops points with fewer than two rays."""
        misfit = self.misfit(index)
        # Eight spreads, 3 px at least: wrong matches are mostly far off, and the blunder test of the final adjustment is stricter.
        unit = max(spread(misfit), 0.3)
        self.good[index[misfit > np.maximum(8.0 * unit, 3.0)]] = False
        alive = np.bincount(self.rays.point[index[self.good[index]]], minlength=len(self.known)) >= 2
        self.known &= alive


def grow(material: GrowthMaterial, seed: tuple[int, int, RelativeOrientation], free: np.ndarray) -> BlockGrowth | None:
    """The block that grows from one pair among the `free` photographs; None where the pair gives too few points."""
    growth = BlockGrowth(material, free)
    left, right, pair = seed
    growth.place(left, np.eye(3), np.zeros(3))
    growth.place(right, rotation_matrix(*np.radians(pair.omega_phi_kappa)), np.array(pair.base))
    growth.triangulate()
    if growth.known.sum() < LEAST_POINTS:
        return None
    try:
        growth.bundle()
        _extend(growth)
        _finish(growth)
    except GeometryError:
        return None
    return growth


def from_given(material: GrowthMaterial, given: Given) -> BlockGrowth:
    """The block that starts from approximate orientations: tolerances shrink from coarse to fine. Photographs that then contradict
    the others are removed and resected again, as are those without an approximate orientation.

    Raises GeometryError where the tie points contradict the orientations.
    """
    growth = BlockGrowth(material, np.ones(len(material.names), bool))
    for photo in np.flatnonzero(given.known):
        growth.place(int(photo), given.rotation[photo], given.centre[photo])
    try:
        for growth.slack in ROUGH:
            # Every round starts again with all rays: what the wide tolerances of the last one kept may be wrong.
            growth.known[:], growth.good[:] = False, growth.seen
            growth.triangulate()
            growth.bundle()
            growth.expel()
        _extend(growth)
        _finish(growth)
    except GeometryError:
        raise GeometryError(STRANGE_START) from None
    of_placed = growth.placed[growth.rays.photo]
    if growth.placed.sum() < 2 or growth.believed[of_placed].mean() < LEAST_SHARE:
        raise GeometryError(STRANGE_START)
    return growth


def _finish(growth: BlockGrowth) -> None:
    """Final tolerances; twice, because points that the first adjustment makes fit belong to the second."""
    growth.slack = 1.0
    for _ in range(2):
        growth.triangulate()
        growth.reconcile()
        growth.bundle()


def _extend(growth: BlockGrowth) -> None:
    """Adds photographs, those that see most known points first, until none can be added."""
    last, everything = growth.placed.sum(), np.arange(len(growth.rays))
    seen = growth.supported(everything)
    while (added := _resected(growth, seen)) is not None:
        photo, before = added
        # A photograph changes what is known of its own points only: looking at all of them would cost the square of the block.
        beside = growth.beside(photo)
        growth.triangulate(beside)
        seen += growth.supported(beside) - before
        if growth.placed.sum() >= max(GROWN * last, last + 1) or growth.placed[growth.free].all():
            growth.bundle()
            growth.triangulate()
            seen, last = growth.supported(everything), growth.placed.sum()


def _resected(growth: BlockGrowth, seen: np.ndarray) -> tuple[int, np.ndarray] | None:
    """The photograph that was added, of those that wait, the first in the order of known points that it has `seen` (P,); and how
    many its own points gave to every photograph before. None where none can be added."""
    waiting = np.flatnonzero(~growth.placed & growth.free)
    # A pair alone is used last: a resection from many points tests what it is made from.
    for place in (growth.resect, growth.join):
        for photo in map(int, waiting[np.argsort(-seen[waiting], kind="stable")]):
            before = growth.supported(growth.beside(photo))
            if place(photo):
                return photo, before
    return None


def _free_network(material: GrowthMaterial, active: np.ndarray, calibrate: bool) -> Network:
    """The network of a free adjustment of the `active` photographs, without positions and control."""
    photos, interior = len(active), material.interior
    weighted = np.asarray(interior.weight.any(axis=(1, 2)))
    free = interior.free & GROWTH_PARAMETERS & (calibrate & weighted)[:, None]
    fixed = replace(interior, free=free, considered=np.zeros_like(free))
    return Network(
        camera_of=material.camera_of[active],
        interior=fixed,
        centre=np.zeros((photos, 3)),
        centre_weight=np.zeros((photos, 3)),
        point=np.zeros((material.points, 3)),
        point_weight=np.zeros((material.points, 3)),
        vertical_weight=np.zeros(photos),
        free=True,
    )


def _resection(points: np.ndarray, ideal_xy: np.ndarray, threshold: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Rotation, centre and the agreeing numbers from points (n, 3) and ideal coordinates (n, 2) in units of c; None when nothing
    agrees."""
    # Points about their median: P3P solves a quartic, whose coefficients lose their digits far from the origin.
    cv2.setRNGSeed(7)
    origin = np.median(points, axis=0)
    vision = np.ascontiguousarray(ideal_xy * [1.0, -1.0])
    found, rvec, tvec, inliers = cv2.solvePnPRansac(
        points - origin,
        vision,
        np.eye(3),
        None,
        iterationsCount=2000,
        reprojectionError=threshold,
        confidence=0.9999,
        flags=cv2.SOLVEPNP_AP3P,
    )
    if not found or inliers is None or len(inliers) < 6:
        return None
    keep = np.asarray(inliers).ravel()
    rvec, tvec = cv2.solvePnPRefineLM((points - origin)[keep], vision[keep], np.eye(3), None, rvec, tvec)
    R = cv2.Rodrigues(rvec)[0]
    return FLIP @ R, origin - R.T @ tvec[:, 0], keep
