"""Blocks with known truth whose points are marked with known errors: what the studies and tests of marks plant their mistakes in.

The block is not adjusted: its estimate is drawn from the covariance that tie points and positions give, which is what an adjustment
of correct observations yields.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.marks import Mark, MarkedPoint, Marks
from orthomill.tasks.adjustment.model.network import Interior, Network, Rays, State
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.geometry.view import View
from orthomill.tasks.marking.belief import Belief, covariance_by

CAMERA = Camera(name="simulated", width=4000, height=3000, c=3000.0, x0=4.0, y0=-6.0)
HEIGHT, RELIEF = 80.0, 8.0
"""m: flying height, standard deviation of the ground"""


@dataclass(frozen=True, eq=False)
class SimulatedBlock:
    """The belief of a block, and its true views."""

    belief: Belief
    views: tuple[View, ...]
    extent: tuple[float, float]


def simulated_block(strips: int, each: int, seed: int = 0, ties: int = 12, position_sigma: float = 0.03) -> SimulatedBlock:
    """Strips of photographs, 80 % and 60 % overlap, `ties` tie points per photograph, positions by RTK."""
    rng = np.random.default_rng(seed)
    base, across = 0.2 * CAMERA.height / CAMERA.c * HEIGHT, 0.4 * CAMERA.width / CAMERA.c * HEIGHT
    centre = np.array([(s * across, i * base, HEIGHT) for s in range(strips) for i in range(each)]) + rng.normal(
        0, 1, (strips * each, 3)
    )
    angles = np.radians(rng.normal(0, (2, 2, 4), (len(centre), 3)))
    rotation = np.array([rotation_matrix(*one) for one in angles])
    photos = len(centre)
    names = tuple(f"photo_{i:04d}" for i in range(photos))
    low, high = centre[:, :2].min(axis=0) - across / 2, centre[:, :2].max(axis=0) + across / 2
    points = np.column_stack([rng.uniform(low, high, (ties * photos, 2)), rng.normal(0, RELIEF / 2, ties * photos)])
    free = np.zeros((1, len(INTERIOR)), bool)
    free[0, :5] = True
    weight = np.zeros((1, len(INTERIOR), len(INTERIOR)))
    weight[0, :5, :5] = np.diag(1.0 / np.array([30.0, 10.0, 10.0, 0.05, 0.05]) ** 2)
    interior = Interior(np.array([CAMERA.interior]), weight, free, np.zeros_like(free))
    network = Network(
        np.zeros(photos, np.int64),
        interior,
        centre,
        np.full((photos, 3), position_sigma**-2.0),
        points,
        np.zeros_like(points),
        np.zeros(photos),
    )
    views = tuple(View(name, CAMERA, R, C) for name, R, C in zip(names, rotation, centre, strict=True))
    state = State(rotation, centre, points, np.array([CAMERA.interior]), np.zeros(0), lens=np.zeros(1))
    rays, kept = _rays(views, points)
    state, network = replace(state, point=points[kept]), replace(network, point=points[kept], point_weight=np.zeros((len(kept), 3)))
    covariance = covariance_by(network, state, rays)
    drawn = np.linalg.cholesky(covariance + 1e-18 * np.eye(len(covariance))) @ rng.standard_normal(len(covariance))
    estimate = _moved(state, drawn, photos)
    belief = Belief(names, (CAMERA,), estimate, network, covariance, np.zeros(3), (0.0, RELIEF), True)
    return SimulatedBlock(belief, views, (float(high[0]), float(high[1])))


def _rays(views: tuple[View, ...], points: np.ndarray) -> tuple[Rays, np.ndarray]:
    rows = []
    for p, view in enumerate(views):
        pixels = view.project(points)
        seen = np.flatnonzero(view.contains(pixels))
        rows.append(np.column_stack([seen, np.full(len(seen), p), pixels[seen]]))
    found = np.concatenate(rows)
    count = np.bincount(found[:, 0].astype(int), minlength=len(points))
    found = found[count[found[:, 0].astype(int)] >= 2]
    kept, number = np.unique(found[:, 0].astype(int), return_inverse=True)
    order = np.lexsort((found[:, 1], number))
    xy = np.column_stack([found[:, 2] - (CAMERA.width - 1) / 2, (CAMERA.height - 1) / 2 - found[:, 3]])[order]
    return Rays(number[order].astype(np.int32), found[order, 1].astype(np.int32), xy, np.full(len(found), 0.4)), kept


def _moved(state: State, drawn: np.ndarray, photos: int) -> State:
    each = drawn[: 6 * photos].reshape(-1, 6)
    rotation = np.array([rotation_of_vector(w) @ R for w, R in zip(each[:, 3:], state.rotation, strict=True)])
    interior = state.interior.copy()
    interior[0, :5] += drawn[6 * photos : 6 * photos + 5]
    return replace(state, rotation=rotation, centre=state.centre + each[:, :3], interior=interior)


def simulated_marks(
    block: SimulatedBlock, seed: int, points: int = 8, most: int = 10, sigma: float = 0.3, ground_sigma: float = 0.02
) -> Marks:
    """Points spread over the block, each marked in up to `most` photographs; two of three are control, the others check points."""
    rng = np.random.default_rng(seed)
    out = []
    while len(out) < points:
        place = np.array([*rng.uniform(0, block.extent), rng.normal(0, RELIEF / 2)])
        seen = [(view.name, view.project(place[None])[0]) for view in block.views]
        seen = [(name, pixel) for name, pixel in seen if np.isfinite(pixel).all() and _inside(pixel)]
        if len(seen) < 4:
            continue
        chosen = rng.permutation(len(seen))[:most]
        marks = {}
        for i in chosen:
            name, pixel = seen[i]
            col, row = map(float, pixel + rng.normal(0, sigma, 2))
            marks[name] = Mark(col=col, row=row, sigma=sigma)
        x, y, z = map(float, place + rng.normal(0, ground_sigma, 3))
        role = "check" if len(out) % 3 == 2 else "control"
        out.append(MarkedPoint(name=f"P{len(out) + 1}", role=role, xyz=(x, y, z), sigma=(ground_sigma,) * 3, marks=marks))
    return Marks(points=tuple(out))


def _inside(pixel: np.ndarray) -> bool:
    return bool((pixel > 20).all() and pixel[0] < CAMERA.width - 20 and pixel[1] < CAMERA.height - 20)
