"""The values of a bundle adjustment: unknowns (`State`), image measurements (`Rays`) and prior information (`Network`).

Coordinates are local (a constant offset near the block is subtracted first), so that float64 resolves a tenth of a micrometre.
Rotations are corrected by small rotation vectors in the image system, for which no attitude is singular; reports print angles.

Order of the unknowns of the reduced system: six per photograph (X, Y, Z, three rotations), then the free interior parameters, the
shifts of the GNSS positions, the lever arms of the antennas, and the points that are kept (ends of measured distances, and points
whose joint covariance is needed). All other points are eliminated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Rays:
    """Image measurements sorted by point: `point`, `photo` (M,) int32, observed `xy` (M, 2) px from the image centre, y up; `sigma`
    (M,) px."""

    point: np.ndarray
    photo: np.ndarray
    xy: np.ndarray
    sigma: np.ndarray

    def __len__(self) -> int:
        return len(self.point)

    def take(self, index: np.ndarray) -> "Rays":
        """The rays at `index` (mask or ascending numbers)."""
        return Rays(self.point[index], self.photo[index], self.xy[index], self.sigma[index])

    def first(self, points: int) -> np.ndarray:
        """(points + 1,): rays first[i] to first[i + 1] belong to point i."""
        return np.searchsorted(self.point, np.arange(points + 1)).astype(np.int64)


@dataclass(frozen=True, eq=False)
class State:
    """Values of the unknowns: `rotation` (P, 3, 3), `centre` (P, 3), `point` (N, 3), `interior` (C, k) the first k of INTERIOR,
    `shift` (S,) m of the positions, `lever` (G, 3) m from the projection centre to the antenna of each receiver in the image
    system (x right, y up, z backwards); `lens` (C,) the codes of the lens models (geometry/distortion.py), Brown's for all by
    default; `variation` (P, k) how the interior orientation of each photograph differs from that of its camera (None: not at
    all)."""

    rotation: np.ndarray
    centre: np.ndarray
    point: np.ndarray
    interior: np.ndarray
    shift: np.ndarray
    lever: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))
    lens: np.ndarray | None = None
    variation: np.ndarray | None = None

    def with_antenna(self, network: "Network", shift: np.ndarray | None = None) -> "State":
        """The state with the lever arms of a network, and with its shifts (S,) m, which are 0 where none are given."""
        return replace(self, lever=network.lever, shift=np.zeros(network.shifts) if shift is None else shift)


@dataclass(frozen=True, eq=False)
class Distances:
    """Measured distances between points: `ends` (D, 2) point numbers, `length` (D,) m, `weight` (D,) 1/m^2, 0 for one that takes no
    part."""

    ends: np.ndarray
    length: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.length)

    @property
    def sigma(self) -> np.ndarray:
        """(D,) standard errors, m; inf for one that takes no part."""
        # A weight of 0 is legal: it belongs to a rejected distance.
        with np.errstate(divide="ignore"):
            return 1.0 / np.sqrt(self.weight)


NO_DISTANCES = Distances(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Interior:
    """Prior knowledge of the cameras: `value` (C, k), `weight` (C, k, k) inverse covariance, `free` (C, k) the parameters that are
    unknowns, `lens` (C,) as in `State`. Those of them that are `considered` (C, k) keep their value, because the block cannot
    determine them reliably, but their covariance propagates into that of all others (Schmidt 1966).
    """

    value: np.ndarray
    weight: np.ndarray
    free: np.ndarray
    considered: np.ndarray
    lens: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Variation:
    """Interior parameters that vary from photograph to photograph: their ascending numbers in INTERIOR (m,), how they are expected
    (P, m) to differ from those of the camera, and the inverse covariance (P, m, m) of that."""

    parameters: np.ndarray
    expected: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.parameters)


NOT_SHIFTED = np.zeros((0, 3), np.int64)
"""No position has a shift."""


def common_shift(photos: int) -> np.ndarray:
    """(P, 3): all positions share one shift."""
    return np.tile(np.arange(3), (photos, 1))


NO_VARIATION = Variation(np.zeros(0, np.int64), np.zeros((0, 0)), np.zeros((0, 0, 0)))


@dataclass(frozen=True, eq=False)
class Network:
    """Prior information; weights are inverse variances, 0 where nothing is known.

    camera_of (P,); centre, centre_weight (P, 3) GNSS positions; point, point_weight (N, 3) control; vertical_weight (P,) 1/rad^2
    of the verticality constraint, whose expected direction is `up` (3,) or (P, 3) in the image system: (0, 0, 1) for a photograph
    that looks straight down; shift (P, 3): the number of the unknown shift that each coordinate of a GNSS position contains (-1:
    none), ascending from 0, those of one flight for instance; shift_weight (S,) 1/m^2: how well it is known that a shift is zero
    (empty: nothing is known of any); free: no datum, inner constraints instead.
    lever (G, 3) m as in `State`, unknowns where lever_weight (3,) 1/m^2 is above 0; receiver (P,): numbers of the receivers, one
    for each drone (empty: one for all); gnss_group (P,): numbers of the groups of positions that were measured alike, each with a
    variance component of its own (empty: all were); kept (K,) ascending numbers of the points that
    stay among the unknowns, the ends of `distances` among them; named: numbers of points that a person measured in the
    photographs, in addition to those with known coordinates; variation: interior parameters that each photograph has for itself.
    """

    camera_of: np.ndarray
    interior: Interior
    centre: np.ndarray
    centre_weight: np.ndarray
    point: np.ndarray
    point_weight: np.ndarray
    vertical_weight: np.ndarray
    shift: np.ndarray = field(default_factory=lambda: NOT_SHIFTED)
    shift_weight: np.ndarray = field(default_factory=lambda: np.zeros(0))
    free: bool = False
    lever: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))
    lever_weight: np.ndarray = field(default_factory=lambda: np.zeros(3))
    receiver: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    gnss_group: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    kept: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    distances: Distances = NO_DISTANCES
    named: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    up: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    variation: Variation = NO_VARIATION

    def with_antenna(
        self, lever: Sequence[float], sigma: float, shift: np.ndarray, receiver: np.ndarray | None = None
    ) -> "Network":
        """The network whose positions are those of antennas: their lever arm (3,) m with a standard error (0: exactly known), the
        shifts (P, 3) and the receivers (P,) as in `Network`. A free network has neither."""
        if self.free or not self.centre_weight.any():
            return self
        weight = np.full(3, 1.0 / sigma**2 if sigma > 0 else 0.0)
        own = np.zeros(0, np.int64) if receiver is None else receiver
        levers = np.tile(np.array(lever, float), (int(own.max(initial=0)) + 1, 1))
        return replace(self, lever=levers, lever_weight=weight, shift=shift, receiver=own)

    def levers(self, lever: np.ndarray) -> np.ndarray:
        """(P, 3) of each photograph, of values (G, 3) of the receivers."""
        return lever[self.receiver] if len(self.receiver) else np.broadcast_to(lever[0], (self.photos, 3))

    @property
    def gnss_groups(self) -> np.ndarray:
        """(P,) the number of each photograph's group of positions."""
        return self.gnss_group if len(self.gnss_group) else np.zeros(self.photos, np.int64)

    @property
    def pointed(self) -> np.ndarray:
        """(N,) bool: points that a person measured in the photographs."""
        by_person = np.asarray(self.point_weight.any(axis=1))
        # Without coordinates, too: check points, and control points whose coordinates were rejected, are pointed at by the same
        # person.
        by_person[self.named] = True
        return by_person

    @property
    def photos(self) -> int:
        """The number of photographs."""
        return len(self.camera_of)

    @property
    def estimated(self) -> np.ndarray:
        """The numbers in INTERIOR of the parameters that are unknowns of some camera or photograph."""
        return np.union1d(np.flatnonzero(self.interior.free.any(axis=0)), self.variation.parameters)

    @property
    def interior_columns(self) -> np.ndarray:
        """(C, k): the column of every interior parameter among the unknowns, -1 where it is fixed."""
        columns = np.full(self.interior.free.shape, -1, np.int64)
        columns[self.interior.free] = 6 * self.photos + np.arange(self.interior.free.sum())
        return columns

    @property
    def variation_columns(self) -> np.ndarray:
        """(P, m): the columns of what varies from photograph to photograph."""
        first = 6 * self.photos + int(self.interior.free.sum())
        return first + np.arange(self.photos * len(self.variation)).reshape(self.photos, -1)

    @property
    def shifts(self) -> int:
        """The number of unknown shifts."""
        return int(self.shift.max(initial=-1)) + 1

    @property
    def shift_weights(self) -> np.ndarray:
        """(S,) 1/m^2 of the shifts; 0: nothing is known."""
        return self.shift_weight if len(self.shift_weight) else np.zeros(self.shifts)

    @property
    def shift_columns(self) -> np.ndarray:
        """(S,) the columns of the shifts."""
        return 6 * self.photos + int(self.interior.free.sum()) + self.variation_columns.size + np.arange(self.shifts)

    @property
    def lever_columns(self) -> np.ndarray:
        """(G, 3) the columns of the lever arms; none (0, 3) where they are known."""
        first = 6 * self.photos + int(self.interior.free.sum()) + self.variation_columns.size + self.shifts
        return first + np.arange(self._lever_unknowns).reshape(-1, 3)

    @property
    def _lever_unknowns(self) -> int:
        return self.lever.size * bool(self.lever_weight.all())

    @property
    def kept_columns(self) -> np.ndarray:
        """(K, 3): the columns of the kept points."""
        # Kept points come last, so that adding some leaves the columns of all others as they are.
        first = self.unknowns - 3 * len(self.kept)
        return first + np.arange(3 * len(self.kept)).reshape(-1, 3)

    @property
    def unknowns(self) -> int:
        """Unknowns of the reduced system."""
        alone = self.shifts + self._lever_unknowns + 3 * len(self.kept)
        return 6 * self.photos + int(self.interior.free.sum()) + self.variation_columns.size + alone

    @property
    def group_start(self) -> np.ndarray:
        """(G + 1,) where the groups of unknowns that always occur together begin: photographs, cameras with free parameters, what
        varies from photograph to photograph, shifts and lever arms as one, kept points."""
        free = self.interior.free.sum(axis=1)
        alone = self.shifts + self._lever_unknowns
        own = np.full(self.photos * (len(self.variation) > 0), len(self.variation))
        sizes = [np.full(self.photos, 6), free[free > 0], own, np.full(int(alone > 0), alone), np.full(len(self.kept), 3)]
        return np.concatenate([[0], np.cumsum(np.concatenate(sizes))]).astype(np.int64)

    @property
    def prior_cliques(self) -> csr_array:
        """(K, G), nonzero: the groups that prior information connects: each photograph with shifts and lever arms, and the ends of
        each distance."""
        groups = len(self.group_start) - 1
        # Ends of distances are kept points, the last groups.
        pairs = groups - len(self.kept) + np.searchsorted(self.kept, self.distances.ends)
        if self.shifts or self.lever_weight.all():
            photos = np.arange(self.photos)
            pairs = np.vstack([pairs, np.column_stack([photos, np.full(self.photos, groups - len(self.kept) - 1)])])
        return csr_array((np.ones(pairs.size), pairs.ravel(), 2 * np.arange(len(pairs) + 1)), shape=(len(pairs), groups))

    @property
    def considered_columns(self) -> np.ndarray:
        """(n,) bool: the columns of parameters that keep their value."""
        columns = np.zeros(self.unknowns, bool)
        columns[self.interior_columns[self.interior.considered]] = True
        return columns

    @property
    def freedoms(self) -> int:
        """The rank defect of a free network: position, orientation, and scale unless a distance gives it."""
        # A distance fixes the scale only while it has weight: rejected ones keep their row with weight 0.
        return (6 if self.distances.weight.any() else 7) * self.free

    @property
    def prior_observations(self) -> int:
        """The number of observed values in the prior information."""
        known = np.diagonal(self.interior.weight, axis1=1, axis2=2) > 0
        return int(
            (self.centre_weight > 0).sum()
            + (self.point_weight > 0).sum()
            + 2 * (self.vertical_weight > 0).sum()  # two tilts: the cross product of two directions has rank two
            + (known & self.interior.free & ~self.interior.considered).sum()
            + self.variation_columns.size
            + self.lever_columns.size
            + (self.shift_weights > 0).sum()
            + (self.distances.weight > 0).sum()
        )


def ray_columns(network: Network, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
    """`row` (M,) and `columns` (T, 6 + k + m), or three more with kept points: ray i depends on the unknowns columns[row[i]], six
    of its photograph, those of its camera that are estimated for any camera, those that vary from photograph to photograph, three
    of its point where that is kept (-1: fixed, or eliminated)."""
    # int32 because a block has tens of millions of rays and one such index for each.
    photo = rays.photo.astype(np.int32, copy=False)
    exterior = np.arange(6 * network.photos).reshape(-1, 6)
    columns = np.hstack([exterior, network.interior_columns[network.camera_of][:, network.estimated], network.variation_columns])
    if not len(network.kept):
        return photo, columns
    # Rays of kept points have rows of their own; all others share that of their photograph.
    own = np.flatnonzero(np.isin(rays.point, network.kept))
    point = network.kept_columns[np.searchsorted(network.kept, rays.point[own])]
    row = photo.copy()
    row[own] = len(columns) + np.arange(len(own))
    nothing = np.full((len(columns), 3), -1)
    return row, np.vstack([np.hstack([columns, nothing]), np.hstack([columns[photo[own]], point])])
