"""Whether rejected corners lie together: where a lens model cannot follow the lens, or a board is not what it is taken for.

Corners that are wrong by themselves (a reflection, a finger, a poor detection) lie anywhere. A model that cannot follow the lens
rejects the corners where it fails, mostly the outermost, and its residuals and standard errors then look fine.
"""

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.diagnosis.advice import Advice, Weakness
from orthomill.tasks.calibration.solving.model_choice import HeldOut

_OUTER = 0.8
"""Share of the corners that are not the outermost."""
_CROWD, _SHARE, _TIMES = 8, 0.05, 3.0
"""Rejected corners lie together in the outer part when there are so many, more than this share, and so many times that of the inner
part."""
_OF_IMAGE, _LEAST = 0.3, 6
"""And in one image of a board when this share of its corners is rejected, and at least so many."""
_ALL = 1.5
"""Largest ratio of the held-out residuals of all corners to those of the corners that are used."""


def failure_advice(result: BoardAdjustment, check: HeldOut | None, photos: list[str]) -> list[Advice]:
    """What rejected corners tell; `photos`: names of the photographs by their numbers."""
    out = []
    if (share := _outer_share(result)) is not None:
        out.append(Advice(Weakness.REJECTED_OUTSIDE, share))
    if images := _crowded_images(result, photos):
        out.append(Advice(Weakness.REJECTED_TOGETHER, names=images))
    if check and check.rms_all > _ALL * check.rms:
        out.append(Advice(Weakness.ALL_WORSE, check.rms_all, values=(check.rms,)))
    return out


def failures(advice: list[Advice]) -> frozenset[Weakness]:
    """The weaknesses for which the calibration must not be signed."""
    found = {one.code for one in advice}
    alone = found & {Weakness.REJECTED_OUTSIDE, Weakness.LARGE_SIGMA0}
    # Either may have a harmless cause; corners rejected together that fit far worse in held-out photographs show the lens.
    together = {Weakness.REJECTED_TOGETHER, Weakness.ALL_WORSE}
    return frozenset(alone | (together if together <= found else set()))


def _outer_share(result: BoardAdjustment) -> float | None:
    """The share of the outermost corners that is rejected; None where it is not remarkable."""
    radius = np.linalg.norm(result.corners.xy - result.state.interior[1:3], axis=1)
    outer, rejected = radius > np.quantile(radius, _OUTER), ~result.used
    if not outer.any() or outer.all():
        return None
    share, inner = float(rejected[outer].mean()), float(rejected[~outer].mean())
    crowd = rejected[outer].sum() >= _CROWD and share > _SHARE and share > _TIMES * inner
    return share if crowd else None


def _crowded_images(result: BoardAdjustment, photos: list[str]) -> tuple[str, ...]:
    """The images of boards of which many corners are rejected."""
    image = result.corners.photo * result.network.boards + result.corners.board
    count = np.bincount(image, minlength=len(photos) * result.network.boards)
    wrong = np.bincount(image, ~result.used, minlength=len(count))
    found = np.flatnonzero((wrong >= _LEAST) & (wrong > _OF_IMAGE * count))
    many = result.network.boards > 1
    return tuple(photos[i // result.network.boards] + f" (board {i % result.network.boards + 1})" * many for i in found.tolist())
