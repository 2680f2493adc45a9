"""Proposals of marks: the marks of a point carried to the other photographs that should show it."""

from collections.abc import Callable

import numpy as np

from orthomill.schemas.marks import ExpectedSight, MarkedPoint, MarkProposal
from orthomill.schemas.raster import Window
from orthomill.tasks.adjustment.model.collinearity import derivatives
from orthomill.tasks.adjustment.model.network import Rays, State
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.patch_matching import HALF, CarriedPatch, SearchedPatch, carried, search_radius

ReadGrey = Callable[[str, Window], np.ndarray]
"""(height, width) float32 of a window of a photograph, NaN outside"""
MOST_PATCHES = 3
"""Marks that are carried; those seen most alike first."""
MOST_STRETCH = 3.0
"""A patch that one photograph shows so many times larger than the other is not matched."""
FAR_OFF = 3.5
"""Standard errors from the expected place beyond which a match is another thing."""
ROOM = 8


def proposals(
    belief: Belief, point: MarkedPoint, sights: tuple[ExpectedSight, ...], place: np.ndarray, read: ReadGrey
) -> tuple[MarkProposal, ...]:
    """A proposal for each of the `sights` of a point at `place` (3,) m in the project's system, by its marks."""
    number = belief.number
    marked = [photo for photo in point.marks if photo in number]
    scale = {
        photo: ground_steps(belief, number[photo], place - belief.offset) for photo in (*marked, *(one.photo for one in sights))
    }
    patches: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    out = []
    for sight in sights:
        ranked = sorted(marked, key=lambda photo: _unlike(scale[photo], scale[sight.photo]))[:MOST_PATCHES]
        given = []
        for photo in ranked:
            affine = scale[sight.photo] @ np.linalg.inv(scale[photo])
            if not (1.0 / MOST_STRETCH < np.sqrt(abs(np.linalg.det(affine))) < MOST_STRETCH):
                continue
            if photo not in patches:
                mark = point.marks[photo]
                patches[photo] = _read_about(read, photo, np.array([mark.col, mark.row]), int(HALF * MOST_STRETCH) + ROOM)
            grey, at = patches[photo]
            given.append(CarriedPatch(grey, at, point.marks[photo].sigma, affine))
        out.append(_proposal(given, sight, read))
    return tuple(out)


def ground_steps(belief: Belief, photo: int, place: np.ndarray) -> np.ndarray:
    """(2, 2) steps (col, row) px per metre along X and Y of level ground at `place` (3,) m, local; along a wall and up where the
    photographs look along the ground."""
    state = State(
        belief.state.rotation, belief.state.centre, place[None], belief.state.interior, belief.state.shift, lens=belief.state.lens
    )
    ray = Rays(np.zeros(1, np.int32), np.array([photo], np.int32), np.zeros((1, 2)), np.ones(1))
    by_point = derivatives(state, ray, belief.network.camera_of)[1][0]
    return by_point @ _facing(belief.state.centre.mean(axis=0) - place) * np.array([[1.0], [-1.0]])


def _facing(direction: np.ndarray) -> np.ndarray:
    """(3, 2) two axes of level ground, or of the wall that faces a direction (3,) from which photographs look along the ground."""
    across = np.hypot(*direction[:2])
    if abs(direction[2]) > 0.5 * across:
        return np.eye(3)[:, :2]
    return np.column_stack([np.array([-direction[1], direction[0], 0.0]) / across, [0.0, 0.0, 1.0]])


def _unlike(first: np.ndarray, second: np.ndarray) -> float:
    """How differently two photographs show a patch: 0 where alike but for a turn."""
    values = np.linalg.svd(second @ np.linalg.inv(first), compute_uv=False)
    return float(np.abs(np.log(np.maximum(values, 1e-6))).sum())


def _read_about(read: ReadGrey, photo: str, at: np.ndarray, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """The pixels about a place, and the place in them."""
    first = np.round(at).astype(int) - reach
    window = Window(row=int(first[1]), col=int(first[0]), height=2 * reach + 1, width=2 * reach + 1)
    return read(photo, window), at - first


def _proposal(given: list[CarriedPatch], sight: ExpectedSight, read: ReadGrey) -> MarkProposal:
    at = np.array(sight.place)
    grey, place = _read_about(read, sight.photo, at, search_radius(sight.covariance) + 2 * HALF + ROOM)
    found = carried(given, SearchedPatch(grey, place, sight.covariance))
    col, row = map(float, found.place + (at - place))
    refused = found.refused
    if not refused:
        away = np.array([col, row]) - at
        spread = sight.covariance + (found.sigma**2 + 0.25) * np.eye(2)
        size = float(np.sqrt(away @ np.linalg.solve(spread, away)))
        if size > FAR_OFF:
            refused = f"{size:.1f} standard errors from where the block expects it"
    return MarkProposal(sight.photo, (col, row), found.sigma, found.correlation, found.rival, refused)
