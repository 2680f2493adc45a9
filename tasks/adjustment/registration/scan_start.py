"""Approximate places of scans: joined one after the other by the points that they share with those already joined.

Control is taken for a scan of its own: where no scan sees three control points, several that are joined do together. Each scan is
placed from three of its common points, those with which most others agree, so that up to half of them may be wrong.
"""

from itertools import combinations

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.registration.scan_network import ScannedPoints, ScanNetwork, ScanState

LEAST = 3
"""Common points that determine rotation and translation, unless they are on a line."""
MOST_TRIPLES = 400
"""Triples that are tried for one scan."""
FLATTEST = 0.02
"""Least height of a triangle of common points in units of its longest side: below it they are as good as on a line."""


def rigid_motion(own: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) with wanted = R own + t for points (N, 3), in the sense of least squares.

    Source: Arun, Huang and Blostein 1987; Umeyama 1991 for the sign.
    """
    rotation, translation = rigid_motions(own[None], wanted[None])
    return rotation[0], translation[0]


def rigid_motions(own: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (K, 3, 3) and translations (K, 3) of K sets of points (K, N, 3), see `rigid_motion`."""
    middle, centre = own.mean(axis=1), wanted.mean(axis=1)
    U, _, Vt = np.linalg.svd((wanted - centre[:, None]).swapaxes(1, 2) @ (own - middle[:, None]))
    # Points in a plane fit a reflection as well as a rotation: the weakest axis takes the sign that makes the determinant +1.
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    R = U @ Vt
    return R, centre - (R @ middle[:, :, None])[:, :, 0]


def start_state(network: ScanNetwork, points: ScannedPoints, names: tuple[str, ...]) -> ScanState:
    """Approximate values of all unknowns; `names` (S,) of the scans. Raises GeometryError for scans that cannot be joined."""
    surveyed = np.flatnonzero(network.weight.any(axis=1))
    placed = np.full((network.points, 3), np.nan)
    rotation, translation = np.tile(np.eye(3), (network.scans, 1, 1)), np.zeros((network.scans, 3))
    placed[surveyed] = network.control[surveyed]
    waiting = set(range(network.scans))
    if len(surveyed) < LEAST or not _best_next(waiting, points, placed):
        # A chain that begins with a scan and meets the control later.
        first = network.reference if network.free else int(np.bincount(points.scan, minlength=network.scans).argmax())
        placed[surveyed] = np.nan
        own = points.take(points.scan == first)
        placed[own.point] = own.xyz
        waiting.remove(first)
    while waiting:
        found = _best_next(waiting, points, placed)
        if found is None:
            raise GeometryError(_not_joined(sorted(waiting), points, placed, names))
        scan, R, t = found
        rotation[scan], translation[scan] = R, t
        own = points.take(points.scan == scan)
        new = np.isnan(placed[own.point, 0])
        placed[own.point[new]] = own.xyz[new] @ R.T + t
        waiting.remove(scan)
    state = ScanState(rotation, translation, np.where(np.isnan(placed), network.control, placed))
    return state if network.free else _on_control(network, state, points)


def _best_next(waiting: set[int], points: ScannedPoints, placed: np.ndarray) -> tuple[int, np.ndarray, np.ndarray] | None:
    """The waiting scan that shares most points with those placed, with its motion; None where no scan can be placed."""
    shared = {k: np.flatnonzero((points.scan == k) & ~np.isnan(placed[points.point, 0])) for k in sorted(waiting)}
    for scan in sorted(shared, key=lambda k: (-len(shared[k]), k)):
        own = points.take(shared[scan])
        motion = robust_motion(own.xyz, placed[own.point])
        if motion is not None:
            return scan, *motion
    return None


def robust_motion(own: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """The motion of the triple of points (N, 3) with which most others agree, by the median of their distances, refined with those
    that do; None where all are as good as on a line."""
    if len(own) < LEAST:
        return None
    triples = np.array(list(combinations(range(len(own)), 3))) if len(own) <= 14 else _drawn(len(own))
    triples = triples[_height(own[triples]) > FLATTEST]
    if not len(triples):
        return None
    rotation, translation = rigid_motions(own[triples[:MOST_TRIPLES]], wanted[triples[:MOST_TRIPLES]])
    away = np.linalg.norm(own @ rotation.swapaxes(1, 2) + translation[:, None] - wanted, axis=2)
    # The middle distance of all, which the three themselves do not decide.
    size = np.sort(away, axis=1)[:, min(len(own) // 2 + 1, len(own) - 1)]
    best = int(size.argmin())
    good = away[best] <= 3.0 * size[best] + 1e-9
    return rigid_motion(own[good], wanted[good])


def _drawn(count: int) -> np.ndarray:
    """(n, 3) triples among many points, the same in every run."""
    generator = np.random.default_rng(count)
    return np.array([generator.choice(count, 3, replace=False) for _ in range(MOST_TRIPLES)])


def _height(triangles: np.ndarray) -> np.ndarray:
    """(N,) of triangles (N, 3, 3): the least height in units of the longest side."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    longest = np.max([(a**2).sum(axis=1), (b**2).sum(axis=1), ((a - b) ** 2).sum(axis=1)], axis=0)
    return np.linalg.norm(np.cross(a, b), axis=1) / np.maximum(longest, 1e-300)


def _on_control(network: ScanNetwork, state: ScanState, points: ScannedPoints) -> ScanState:
    """The state moved as a whole onto the control. Raises GeometryError where too little of it was scanned."""
    known = np.flatnonzero(network.weight.any(axis=1) & (np.bincount(points.point, minlength=network.points) > 0))
    scanned = np.array([state.placed(points)[points.point == i].mean(axis=0) for i in known]).reshape(-1, 3)
    motion = robust_motion(scanned, network.control[known])
    if motion is None:
        raise GeometryError(
            f"The scans show {len(known)} of the control points, or only such as lie on one line; three or more that form a "
            "triangle are needed, or leave out the control, and the first scan defines the system."
        )
    R, t = motion
    return ScanState(R @ state.rotation, state.translation @ R.T + t, state.point @ R.T + t)


def _not_joined(waiting: list[int], points: ScannedPoints, placed: np.ndarray, names: tuple[str, ...]) -> str:
    rows = ~np.isnan(placed[points.point, 0])
    said = ", ".join(f"{names[k]} ({int((rows & (points.scan == k)).sum())})" for k in waiting[:8])
    return (
        f"{len(waiting)} of the scans cannot be joined to the others; points in common: {said}. Each scan needs three points in "
        "common with the others or with the control that are not on one line: measure more targets in it, or compare their names."
    )
