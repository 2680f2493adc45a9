"""Marks as observations of a block that is known with its covariance: what they leave, what they put where, what contradicts them.

The block enters by what it predicts of the marks. With w = marked - predicted, S the covariance of w (of the orientation, of the
marks, of known coordinates) and B the derivatives of the marks by coordinates that are not known,

    P = S^-1 - S^-1 B (B' S^-1 B)^-1 B' S^-1

gives everything that the adjustment with these marks would: residuals R P w, and for every alternative that adds parameters C to
the model its size (C' P C)^-1 C' P w and the quadratic form by which it is tested (Baarda 1968; the same as least squares with the
block's normal equations, by the matrix inversion lemma). P has the size of the marks: a solution takes milliseconds, whatever the
number of tie points.

Marks are linearised at the place where most rays of a point meet (ray_meeting.py), which wrong ones among them do not move.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, vstack

from orthomill.tasks.adjustment.model.collinearity import BEHIND, derivatives, residuals
from orthomill.tasks.adjustment.model.network import Rays, State, ray_columns
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.ray_meeting import MarkedRays, placed

WEAK = 0.05
"""Redundancy below which nothing checks a mark."""


@dataclass(frozen=True, eq=False)
class PredictedPlaces:
    """Where photographs show a point: `place` (m, 2) px from the image centre, y up, covariances (m, 2, 2) px^2, standard error of
    the point (3, 3) m^2 now and (m, 3, 3) with a mark in each of them."""

    xy: np.ndarray
    covariance: np.ndarray
    point: np.ndarray
    with_mark: np.ndarray


@dataclass(frozen=True, eq=False)
class MarkSolution:
    """The marks of points that can be placed: see the strategy of this file. `start` (N, 3) m, local, NaN for points that nothing
    places; `rays` (those of placed points), `w` (2M,) px, `J` (2M, n) by the unknowns of the block, `B` (2M, N, 3)."""

    belief: Belief
    marked: MarkedRays
    start: np.ndarray
    w: np.ndarray
    J: csr_array
    B: np.ndarray
    free: np.ndarray
    """(N,) bool: points whose coordinates are not known"""

    @cached_property
    def carried(self) -> np.ndarray:
        """(n, 2M) the covariance of the unknowns with what the block predicts of the marks."""
        return (self.J @ self.belief.covariance).T

    @cached_property
    def variances(self) -> np.ndarray:
        """(2M,) px^2, of the marks alone."""
        return np.repeat(self.marked.rays.sigma**2, 2)

    @cached_property
    def inverse(self) -> np.ndarray:
        """S^-1 (2M, 2M)."""
        S = self.J @ self.carried + np.diag(self.variances)
        for point in np.flatnonzero(~self.free & np.isfinite(self.start).all(axis=1)):
            S += (self.B[:, point] * self.marked.sigma[point] ** 2) @ self.B[:, point].T
        return np.linalg.inv(S)

    @cached_property
    def open(self) -> np.ndarray:
        """(2M, 3F) the derivatives by coordinates that are not known."""
        return self.B[:, self._open_points].reshape(len(self.w), 3 * len(self._open_points))

    @cached_property
    def _open_points(self) -> np.ndarray:
        return np.flatnonzero(self.free & np.isfinite(self.start).all(axis=1))

    @cached_property
    def _open_covariance(self) -> np.ndarray:
        """(B' S^-1 B)^-1."""
        return np.linalg.inv(self.open.T @ self.inverse @ self.open)

    @cached_property
    def weight(self) -> np.ndarray:
        """(2M, 2M) the weights of the misfits: see the strategy."""
        SB = self.inverse @ self.open
        return self.inverse - SB @ self._open_covariance @ SB.T

    @cached_property
    def pull(self) -> np.ndarray:
        """P w (2M,)."""
        return self.weight @ self.w

    @cached_property
    def residual(self) -> np.ndarray:
        """(M, 2) px, marked minus adjusted."""
        return (self.variances * self.pull).reshape(-1, 2)

    @cached_property
    def correction(self) -> np.ndarray:
        """(n,) of the unknowns of the block by the marks."""
        return self.carried @ self.pull

    def alternative(self, C: np.ndarray) -> tuple[float, np.ndarray]:
        """The quadratic form by which additional parameters with derivatives C (2M, k) are tested, and their values (k,)."""
        normal, right = C.T @ self.weight @ C, C.T @ self.pull
        values = np.linalg.lstsq(normal, right, rcond=1e-9)[0]
        return float(right @ values), values

    @cached_property
    def mark_tests(self) -> tuple[np.ndarray, np.ndarray]:
        """Test values (M,) of the marks, in standard errors, NaN where nothing checks them, and how far each is off (M, 2) px by
        all others."""
        count = len(self.marked.rays)
        blocks = self.weight.reshape(count, 2, count, 2)[np.arange(count), :, np.arange(count)]
        pull = self.pull.reshape(-1, 2)
        weakest = np.linalg.eigvalsh(blocks)[:, 0] * self.marked.rays.sigma**2
        checked = weakest > WEAK
        off = np.full((count, 2), np.nan)
        off[checked] = np.linalg.solve(blocks[checked], pull[checked][:, :, None])[:, :, 0]
        return np.sqrt(np.maximum((off * pull).sum(axis=1), 0.0)), off

    @cached_property
    def places(self) -> np.ndarray:
        """(N, 3) m, local: the points by everything."""
        out = self.start.copy()
        for point in np.flatnonzero(~self.free & np.isfinite(self.start).all(axis=1)):
            out[point] = self.marked.known[point] + self.marked.sigma[point] ** 2 * (self.B[:, point].T @ self.pull)
        if len(self._open_points):
            out[self._open_points] += (self._open_covariance @ (self.open.T @ self.inverse @ self.w)).reshape(-1, 3)
        return out

    def predicted(self, point: int, photos: np.ndarray, sigma: float = 0.5) -> PredictedPlaces:
        """Where `photos` (m,) show a point that has a place; a mark there would have the standard error `sigma`, px."""
        m = len(photos)
        state = replace(self.belief.state, point=self.start[[point]])
        rays = Rays(np.zeros(m, np.int32), photos.astype(np.int32), np.zeros((m, 2)), np.ones(m))
        J, Bp = _derivatives(self.belief, state, rays)
        computed = -residuals(state, rays, self.belief.network.camera_of)
        # The point and the marks as one vector of quantities to be predicted from the misfits.
        A = np.vstack([np.eye(3), Bp.reshape(2 * m, 3)])
        known = np.zeros((3, 3)) if self.free[point] else np.diag(self.marked.sigma[point] ** 2)
        by_block = vstack([csr_array((3, J.shape[1])), J], format="csr")
        prior = by_block @ (by_block @ self.belief.covariance).T + A @ known @ A.T
        with_marks = by_block @ self.carried + A @ known @ self.B[:, point].T
        gained = with_marks @ self.inverse
        mean = (np.zeros(len(A)) if self.free[point] else A @ (self.marked.known - self.start)[point]) + gained @ self.w
        posterior = prior - gained @ with_marks.T
        if len(self._open_points):
            own = np.zeros((len(A), self.open.shape[1]))
            if self.free[point]:
                at = 3 * int(np.searchsorted(self._open_points, point))
                own[:, at : at + 3] = A
            rest = own - gained @ self.open
            values = self._open_covariance @ (self.open.T @ self.inverse @ self.w)
            mean, posterior = mean + rest @ values, posterior + rest @ self._open_covariance @ rest.T
        at_marks = np.arange(3, 3 + 2 * m).reshape(m, 2)
        own = posterior[at_marks[:, :, None], at_marks[:, None, :]]
        cross = posterior[:3][:, at_marks].swapaxes(0, 1)
        lessened = cross @ np.linalg.inv(own + sigma**2 * np.eye(2)) @ cross.swapaxes(1, 2)
        xy = computed + mean[at_marks]
        xy[(np.abs(computed) >= 0.9 * BEHIND).any(axis=1)] = np.nan
        return PredictedPlaces(xy, own, posterior[:3, :3], posterior[:3, :3] - lessened)

    def covariance_of(self, point: int) -> np.ndarray:
        """(3, 3) m^2 of a placed point."""
        return self.predicted(point, np.zeros(1, np.int64)).point


def solved(belief: Belief, marked: MarkedRays, starts: np.ndarray | None = None) -> MarkSolution:
    """The marks against the belief; rays of points that nothing places take no part. `starts` (N, 3): where the points were placed
    before, which saves the search."""
    rays, count = marked.rays, len(marked.known)
    start = placed(belief, marked) if starts is None else starts
    seen = np.isfinite(start).all(axis=1)
    marked = replace(marked, rays=rays.take(seen[rays.point]))
    rays = marked.rays
    state = replace(belief.state, point=np.where(np.isfinite(start), start, 0.0))
    J, Bp = _derivatives(belief, state, rays)
    B = np.zeros((2 * len(rays), count, 3))
    B[np.arange(2 * len(rays)), np.repeat(rays.point, 2)] = Bp.reshape(-1, 3)
    free = ~np.isfinite(marked.known).all(axis=1)
    w = residuals(state, rays, belief.network.camera_of)
    shift = np.where(free[:, None], 0.0, marked.known - start)
    w = (w - np.einsum("mki,mi->mk", Bp, shift[rays.point])).ravel()
    return MarkSolution(belief, marked, start, w, J, B, free)


def _derivatives(belief: Belief, state: State, rays: Rays) -> tuple[csr_array, np.ndarray]:
    """(2M, n) by the unknowns of the block, (M, 2, 3) by the points."""
    network = replace(belief.network, point=state.point, point_weight=np.zeros_like(state.point))
    jg, jp = derivatives(state, rays, network.camera_of, network.estimated)
    row, columns = ray_columns(network, rays)
    own = np.repeat(columns[row], 2, axis=0)
    values = jg.reshape(len(own), jg.shape[2])
    line, at = np.nonzero(own >= 0)
    return csr_array((values[line, at], (line, own[line, at])), shape=(len(own), network.unknowns)), jp


def pushed_intersection(
    belief: Belief, place: np.ndarray, photos: np.ndarray, sigma: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """How the intersection of the rays of `photos` (m,) at a place (3,) m, local, follows the unknowns of the block: (3, n), and
    its covariance (3, 3) m^2 by marks with the standard error `sigma`, px; None where the rays are nearly parallel."""
    m = len(photos)
    state = replace(belief.state, point=place[None])
    J, by_point = _derivatives(belief, state, Rays(np.zeros(m, np.int32), photos.astype(np.int32), np.zeros((m, 2)), np.ones(m)))
    B = by_point.reshape(2 * m, 3)
    normal = B.T @ B
    if np.linalg.cond(normal) > 1e10:
        return None
    inverse = np.linalg.inv(normal)
    return -inverse @ (J.T @ B).T, sigma**2 * inverse
