"""The relative orientation of one pair of a block in the classical forms, as a report of the pair prints it: from its tie points
alone, by the published procedure, and derived from the exterior orientations of the block.

Strategy. The classical forms want the base along the x axis of the left photograph and a right photograph that is hardly turned
against it. Image systems have four axes to choose from: both are turned by quarter turns until that is so, as an operator would
have put the diapositives into the instrument.

Standard errors from the tie points are those of a known camera, as published. Those from the block hold the errors of its camera as
well: where the camera is poorly determined, they are larger, for an error of the principal point is one of the relative tilt.

Source: Karfis 2009, sections 3.3 and 3.4 (sources/epipolar.md#relative-orientation, #rejection); Skarlatos, tables
4.15 and 4.17 (sources/surface_check.md#table-4-15, #table-4-17).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.inspection import PairForms, PairUnknown
from orthomill.schemas.observations import TiePoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.solve.mixed_model import MixedSolution, solve_mixed
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.measurements import tie_rays
from orthomill.tasks.orientation.relative.pairs import common_rays, ideal_coordinates
from orthomill.tasks.orientation.relative.relative_forms import (
    DependentOrientation,
    FiveRotations,
    dependent_form,
    derived_precision,
    five_rotation_form,
    from_exterior,
)
from orthomill.tasks.orientation.relative.relative_orientation import orient_dependent

Unknowns = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""base (3,) and rotation (3, 3) to the five unknowns of a form"""
_DEPENDENT = ("b_y / b_x", "b_z / b_x", "omega", "phi", "kappa")
_FIVE = ("kappa 1", "kappa 2", "phi 1", "phi 2", "omega 2")
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
    observations = _observations(block, photos, tie_points, (left, right), pair)
    found = orient_dependent(observations, *pair.constants)
    five = solve_mixed(FiveRotations(*pair.constants), observations[found.kept])
    dependent = _rows("dependent", _DEPENDENT, found.solution, pair, lambda b, R: dependent_form(b, R, *pair.constants).unknowns)
    rotations = _rows("five rotations", _FIVE, five, pair, lambda b, R: five_rotation_form(b, R, *pair.constants).unknowns)
    return PairForms(
        left=left,
        right=right,
        quarter_turns=pair.turns,
        matches=len(found.kept),
        kept=int(found.kept.sum()),
        sigma0_px=float(found.solution.sigma0),
        unknowns=(*dependent, *rotations),
    )


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


def _observations(block: Block, photos: Photos, tie_points: TiePoints, names: tuple[str, str], pair: _Pair) -> np.ndarray:
    """(s, 4): ideal coordinates of the common tie points in the turned systems, px. Raises GeometryError for too few."""
    numbers = [photos.names.index(name) for name in names]
    mine = tie_points.take(np.isin(tie_points.photo, numbers))
    cameras = Cameras(cameras=block.cameras, of_photo=block.of_photo)
    rays, _ = tie_rays(photos, cameras, mine)
    of_photo = rows_of_photos(rays.photo, len(photos.names))
    both = common_rays(rays, *(of_photo[number] for number in numbers))
    if len(both[0]) < 6:
        raise GeometryError(
            f"{names[0]} and {names[1]} share {len(both[0])} tie points; a relative orientation needs six, so name two neighbours."
        )
    coordinates = ideal_coordinates(photos, cameras, rays)
    sides = zip(both, pair.turns, pair.constants, strict=True)
    return np.hstack([c * coordinates[own] @ _quarter(turn)[:2, :2].T for own, turn, c in sides])


def _rows(
    form: str,
    names: tuple[str, ...],
    solution: MixedSolution[DependentOrientation] | MixedSolution[FiveRotations],
    pair: _Pair,
    unknowns: Unknowns,
) -> list[PairUnknown]:
    """The unknowns of a form, angles in degrees."""
    if pair.covariance is None:
        of_block, spread = unknowns(*from_exterior(pair.exterior)), None
    else:
        of_block, covariance = derived_precision(pair.exterior, pair.covariance, unknowns)
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    of_points = solution.model.unknowns
    own = solution.standard_errors if solution.redundancy else None
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
