"""The lens models that a calibration chooses from, and the change from one to another.

Brown's polynomial follows most lenses. One that sees more than about 90 degrees bends the radius so much that a polynomial either
rejects the outer corners or waves between them; a quotient of polynomials, the angle instead of its tangent, or the division model
follow it with few coefficients. A model starts from the solution of another one: its coefficients are fitted to the radial curve
of that solution over the radii that corners reach.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from orthomill.schemas.camera import LensKind
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardState
from orthomill.tasks.adjustment.boards.board_projection import ideal_points
from orthomill.tasks.geometry.distortion import distorted, lens_numbers


class LensModel(NamedTuple):
    """A kind of lens, and the interior parameters that are estimated; all others are zero."""

    lens: LensKind
    free: tuple[str, ...]


MODELS = (
    LensModel("brown", ("c", "x0", "y0", "k1", "k2")),
    LensModel("brown", ("c", "x0", "y0", "k1", "k2", "p1", "p2")),
    LensModel("brown", ("c", "x0", "y0", "k1", "k2", "k3")),
    LensModel("brown", ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2")),
)
"""Brown's models to choose from, smallest first."""
WIDE_MODELS = (
    LensModel("division", ("c", "x0", "y0", "k1")),
    LensModel("fisheye", ("c", "x0", "y0", "k1", "k2", "k3", "k4")),
    LensModel("rational", ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "k4", "k5", "k6")),
    LensModel("thin_prism", ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "k4", "k5", "k6", "s1", "s2", "s3", "s4")),
)
"""Those for wide lenses, smallest first; a model is only taken where no smaller one fits as well."""
_RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
_CURVE = 40
"""Radii at which one model is fitted to another."""


def model_of(lens: LensKind | None, free: tuple[str, ...]) -> tuple[LensModel, ...]:
    """The models to compare: the stated parameters, or all models of a stated lens, or all (None and no parameters)."""
    if free:
        return (LensModel(lens or "brown", free),)
    return tuple(model for model in (*MODELS, *WIDE_MODELS) if lens in (None, model.lens))


def with_affinity(model: LensModel, free: bool = True) -> LensModel:
    """The model for pixels that need not be square, or (not `free`) that are."""
    names = {*model.free, "affinity"} if free else {*model.free} - {"affinity"}
    return LensModel(model.lens, tuple(name for name in PARAMETERS if name in names))


def in_model(state: BoardState, corners: BoardCorners, model: LensModel) -> BoardState:
    """The state as a start for another model: what both estimate is kept, the radial curve is fitted, all else is zero."""
    kept = {name: float(state.interior[k]) for k, name in enumerate(PARAMETERS) if name in model.free}
    zero = state.with_interior(**dict.fromkeys(PARAMETERS[1:], 0.0))
    if model.lens == state.lens:
        return zero.with_interior(**kept)
    other = {name: value for name, value in kept.items() if name not in _RADIAL}
    radial = tuple(name for name in model.free if name in _RADIAL)
    return replace(zero, lens=model.lens).with_interior(**(other | _fitted(state, corners, model.lens, radial)))


def _fitted(state: BoardState, corners: BoardCorners, lens: LensKind, radial: tuple[str, ...]) -> dict[str, float]:
    """c and the radial coefficients of a lens with nearly the same curve as the state's."""
    reach = np.nanmax(np.linalg.norm(ideal_points(state, corners), axis=1))
    points = np.column_stack([np.linspace(0.0, reach, _CURVE + 1)[1:], np.zeros(_CURVE)])
    plain = state.with_interior(p1=0.0, p2=0.0, affinity=0.0, skew=0.0, s1=0.0, s2=0.0, s3=0.0, s4=0.0)
    curve = distorted(points, plain.numbers)[:, 0]
    # Rejected corners may lie where the former curve has folded back: there it says nothing.
    rising = np.minimum.accumulate(np.append(True, np.diff(curve) > 0)).astype(bool)

    def missed(values: np.ndarray) -> np.ndarray:
        interior = np.zeros(len(PARAMETERS))
        interior[[PARAMETERS.index(name) for name in radial]] = values[1:]
        with np.errstate(invalid="ignore", over="ignore"):
            found = values[0] * distorted(points[rising], lens_numbers(interior, lens))[:, 0]
        return np.nan_to_num(found - curve[rising], nan=1e3, posinf=1e3, neginf=-1e3)

    start = np.append(1.0, np.zeros(len(radial)))
    fit = least_squares(missed, start, x_scale="jac", max_nfev=200).x
    return {"c": float(state.interior[0] * fit[0]), **dict(zip(radial, fit[1:].tolist(), strict=True))}
