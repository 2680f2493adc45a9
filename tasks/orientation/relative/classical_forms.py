"""The relative orientation of one pair of a block in the classical forms, as a report of the pair prints it: from its tie points
alone, by the published procedure, and derived from the exterior orientations of the block.

Strategy. The classical forms want the base along the x axis of the left photograph and a right photograph that is hardly turned
against it. Image systems have four axes to choose from: both are turned by quarter turns until that is so, as an operator would
have put the diapositives into the instrument.

The published procedure may end in a wrong minimum without a word, as few wrong matches suffice to hide each other: the pair is
started from five points as well, and where that fits far better it counts, and the failure is named. Standard errors from the tie
points are those that parts of the photograph show, not less than the published ones, and hold the errors of the camera
(pair_precision.py), as those from the block do.

Source: Karfis 2009, sections 3.3 and 3.4 (sources/epipolar.md#relative-orientation, #rejection); Skarlatos, tables
4.15 and 4.17 (sources/surface_check.md#table-4-15, #table-4-17).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.inspections.inspection import PairForms, PairUnknown
from orthomill.schemas.observations import TiePoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.solve.mixed_model import MixedSolution, solve_mixed
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.measurements import tie_rays
from orthomill.tasks.orientation.relative.pair_precision import axes, camera_effect, scatter
from orthomill.tasks.orientation.relative.pairs import common_rays, ideal_coordinates
from orthomill.tasks.orientation.relative.relative_forms import (
    DependentOrientation,
    FiveRotations,
    dependent_form,
    derived_precision,
    five_rotation_form,
    from_exterior,
)
from orthomill.tasks.orientation.relative.relative_orientation import Relative, orient_dependent, orient_robust

Unknowns = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""base (3,) and rotation (3, 3) to the five unknowns of a form"""
_DEPENDENT = ("b_y / b_x", "b_z / b_x", "omega", "phi", "kappa")
_FIVE = ("kappa 1", "kappa 2", "phi 1", "phi 2", "omega 2")
_WRONG, _AGREEING = 3.0, 0.4
"""times the sigma0 of a start from five points from which on the published one went wrong, and share of the tie points that must
agree with these"""
_LEAST_ALONG = 0.5
"""share of the base that has to lie along x after the best quarter turn; 0.7 is what is left of one between two axes"""


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two oriented photographs whose image systems are turned. exterior (12,): m and radians; covariance (12, 12) or None."""

    turns: tuple[int, int]
    exterior: np.ndarray
    covariance: np.ndarray | None
    constants: tuple[float, float]


def classical_forms(block: Block, photos: Photos, tie_points: TiePoints, left: str, right: str) -> PairForms:
    """The dependent form and that of five rotations of a pair, each from the tie points and from the block.

    Raises PhotoError for a photograph that is not in the block, GeometryError for a pair without a base along an axis of the image
    or with too few tie points.
    """
    for name in (left, right):
        block.check_holds(name)
    pair = _turned(block, left, right)
    matches = _Matches.of(block, photos, tie_points, (left, right), pair)
    observations = matches.observations(block)
    found, failed = _started(observations, pair)
    kept, model = observations[found.kept], found.solution.model
    changed = [matches.observations(moved)[found.kept] for moved in _moved_cameras(block, left, right)]
    five = solve_mixed(five_rotation_form(model.base, model.rotation, *pair.constants), kept)
    spreads = [_spread(solution, kept, changed) for solution in (found.solution, five)]
    dependent = _rows(
        "dependent", _DEPENDENT, (model.unknowns, spreads[0]), pair, lambda b, R: dependent_form(b, R, *pair.constants).unknowns
    )
    rotations = _rows(
        "five rotations",
        _FIVE,
        (five.model.unknowns, spreads[1]),
        pair,
        lambda b, R: five_rotation_form(b, R, *pair.constants).unknowns,
    )
    return PairForms(
        left=left,
        right=right,
        quarter_turns=pair.turns,
        matches=len(found.kept),
        kept=int(found.kept.sum()),
        sigma0_px=float(found.solution.sigma0),
        unknowns=(*dependent, *rotations),
        failed_start=failed,
    )


def _started(observations: np.ndarray, pair: _Pair) -> tuple[Relative, tuple[int, float] | None]:
    """The pair by the published procedure, and what that ended in where five points give a far better one, which is taken."""
    published = orient_dependent(observations, *pair.constants)
    try:
        robust = orient_robust(observations, *pair.constants)
        start = dependent_form(robust.solution.model.base, robust.solution.model.rotation, *pair.constants)
        again = Relative(solve_mixed(start, observations[robust.kept]), robust.kept)
    except GeometryError:
        return published, None
    sigma0 = float(published.solution.sigma0)
    if again.kept.mean() >= _AGREEING and _WRONG * again.solution.sigma0 < sigma0:
        return again, (int(published.kept.sum()), sigma0)
    return published, None


def _spread(
    solution: MixedSolution[DependentOrientation] | MixedSolution[FiveRotations], kept: np.ndarray, changed: list[np.ndarray]
) -> np.ndarray | None:
    """Standard errors (5,) of the unknowns, angles in radians; None without redundancy."""
    if not solution.redundancy:
        return None

    def orient(observations: np.ndarray) -> np.ndarray:
        return solve_mixed(solution.model, observations).model.unknowns

    formal, shown = solution.standard_errors**2, scatter(kept, orient)
    own = formal if shown is None else np.maximum(formal, shown)
    return np.sqrt(own + camera_effect(changed, orient, solution.model.unknowns))


def _moved_cameras(block: Block, left: str, right: str) -> Iterator[Block]:
    """The block with each camera of the pair moved along every axis of its covariance by one standard error."""
    for name in dict.fromkeys(block.of_photo[photo] for photo in (left, right)):
        camera = block.cameras[name]
        for change in axes(np.array(camera.covariance)) if camera.covariance is not None else ():
            moved = camera.with_interior(np.array(camera.interior) + change)
            yield block.model_copy(update={"cameras": {**block.cameras, name: moved}})


def _turned(block: Block, left: str, right: str) -> _Pair:
    """The pair with its image systems turned so that the base lies along x. Raises GeometryError where no quarter turn helps."""
    orientations = [block.of(name) for name in (left, right)]
    exterior = np.concatenate([(*o.centre, *np.radians(o.omega_phi_kappa)) for o in orientations])
    base, rotation = from_exterior(exterior)
    first = int(np.argmax([(_quarter(turn) @ base)[0] for turn in range(4)]))
    along = float((_quarter(first) @ base)[0])
    if along < _LEAST_ALONG:
        raise GeometryError(
            f"The base of {left} and {right} lies along the view of {left} ({100 * along:.0f} % of it along an axis of the image); "
            "the classical forms are for photographs beside each other."
        )
    second = int(np.argmax([np.trace(_quarter(turn) @ rotation @ _quarter(first).T) for turn in range(4)]))
    # Turning an image system about its axis adds to kappa alone: the covariance of the angles stays as it is.
    for k, turn in ((5, first), (11, second)):
        exterior[k] += turn * np.pi / 2
    constants = block.camera_of(left).c, block.camera_of(right).c
    return _Pair((first, second), exterior, _joint_covariance(block, left, right), constants)


def _quarter(turn: int) -> np.ndarray:
    return rotation_matrix(0.0, 0.0, turn * np.pi / 2)


def _joint_covariance(block: Block, left: str, right: str) -> np.ndarray | None:
    """(12, 12) of both exterior orientations; None where the block does not hold it."""
    own = [block.of(name).covariance for name in (left, right)]
    both = next((j for j in block.joint if {j.first, j.second} == {left, right}), None)
    if own[0] is None or own[1] is None or both is None:
        return None
    between = np.array(both.covariance) if both.first == left else np.array(both.covariance).T
    return np.block([[np.array(own[0]), between], [between.T, np.array(own[1])]])


@dataclass(frozen=True, eq=False)
class _Matches:
    """The common tie points of a pair, whose ideal coordinates follow from the cameras."""

    photos: Photos
    tie_points: TiePoints
    names: tuple[str, str]
    pair: _Pair

    @classmethod
    def of(cls, block: Block, photos: Photos, tie_points: TiePoints, names: tuple[str, str], pair: _Pair) -> "_Matches":
        """Raises GeometryError for too few."""
        numbers = [photos.names.index(name) for name in names]
        mine = tie_points.take(np.isin(tie_points.photo, numbers))
        found = cls(photos, mine, names, pair)
        if (count := len(found.observations(block))) < 6:
            raise GeometryError(
                f"{names[0]} and {names[1]} share {count} tie points; a relative orientation needs six, so name two neighbours."
            )
        return found

    def observations(self, block: Block) -> np.ndarray:
        """(s, 4): ideal coordinates in the turned systems with the cameras of `block`, px of the pair's own constants."""
        cameras = Cameras(cameras=block.cameras, of_photo=block.of_photo)
        rays, _ = tie_rays(self.photos, cameras, self.tie_points)
        of_photo = rows_of_photos(rays.photo, len(self.photos.names))
        both = common_rays(rays, *(of_photo[self.photos.names.index(name)] for name in self.names))
        coordinates = ideal_coordinates(self.photos, cameras, rays)
        sides = zip(both, self.pair.turns, self.pair.constants, strict=True)
        return np.hstack([c * coordinates[own] @ _quarter(turn)[:2, :2].T for own, turn, c in sides])


def _rows(
    form: str, names: tuple[str, ...], points: tuple[np.ndarray, np.ndarray | None], pair: _Pair, unknowns: Unknowns
) -> list[PairUnknown]:
    """The unknowns of a form, angles in degrees; points: those of the tie points (5,), with their standard errors (5,)."""
    of_points, own = points
    if pair.covariance is None:
        of_block, spread = unknowns(*from_exterior(pair.exterior)), None
    else:
        of_block, covariance = derived_precision(pair.exterior, pair.covariance, unknowns)
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = []
    for k, name in enumerate(names):
        angle = not name.startswith("b_")
        unit = 180.0 / np.pi if angle else 1.0
        sigmas = [None if sigma is None else float(unit * sigma[k]) for sigma in (own, spread)]
        row = PairUnknown(
            form=form,
            name=name,
            unit="degrees" if angle else "",
            of_points=float(unit * of_points[k]),
            sigma_of_points=sigmas[0],
            of_block=float(unit * of_block[k]),
            sigma_of_block=sigmas[1],
        )
        rows.append(row)
    return rows
