"""Runs the chain of the stage on a simulated block, and compares with truth."""

import hashlib
import pickle

import numpy as np

from orthomill.schemas.orientation import RelativeOrientations
from orthomill.tasks.adjustment.model.interior_settings import WeightedInterior
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices
from orthomill.tasks.orientation.relative.pairs import relate_pairs

_MET: dict[bytes, RelativeOrientations] = {}


def related(block):
    """The related pairs of a block: of the same photographs, cameras and tie points they are found once in a process, for tests
    differ in control and in choices more often than in these."""
    key = hashlib.sha256(pickle.dumps((block.photos, block.cameras, block.tie_points))).digest()
    if key not in _MET:
        _MET[key] = relate_pairs(block.photos, block.cameras, block.tie_points, 15)
    return _MET[key]


def orient(block, given=None, relative=None, heights=None, lattice=None, **changes):
    """The tables of the stage; `relative`: the related pairs, where they are known already; `heights` on a `lattice` of an
    elevation model."""
    usual = {"interior": WeightedInterior(kind="weighted"), "gnss_shift": "auto", "vertical_sigma": 5.0, "rejection": 4.0}
    relative = relative or related(block)
    choices = BlockChoices(**(usual | changes))
    measured = block.photos, block.cameras, block.tie_points, block.control, relative
    out = orient_block(*measured, "EPSG:2100", choices, given, heights, lattice)
    return out._asdict() | {"relative": relative}


def sentences(precision):
    """What the report says of the findings of an adjustment."""
    return [finding.sentence for finding in precision.findings]


def standardised_orientation(block, result):
    """(photos, 6): errors of the exterior orientations in units of their own standard errors."""
    rows = []
    for view in block.views:
        found = result.of(view.name)
        turn = (np.radians(found.omega_phi_kappa) - angles(view.rotation) + np.pi) % (2 * np.pi) - np.pi
        sigma = np.sqrt(np.diag(np.array(found.covariance)))
        rows.append(np.concatenate([np.array(found.centre) - view.centre, turn]) / sigma)
    return np.array(rows)


def ground_errors(block, points):
    """Errors (n, 3) of the tie points on the ground, and their standard errors."""
    error = np.column_stack([points.x, points.y, points.z]) - block.ground[points.track]
    return error, np.column_stack([points.sigma_x, points.sigma_y, points.sigma_z])


def standardised_lengths(block, result, scale=1.0):
    """(pairs,) errors of the distances between projection centres in units of their standard errors, for pairs that share tie
    points; `scale`: true by found."""
    truth, rows = {v.name: v.centre for v in block.views}, []
    for pair in result.joint:
        own = [np.array(result.of(name).centre) for name in (pair.first, pair.second)]
        along = own[1] - own[0]
        length = np.linalg.norm(along)
        single = sum(np.array(result.of(name).covariance)[:3, :3] for name in (pair.first, pair.second))
        cross = np.array(pair.covariance)[:3, :3]
        sigma = np.sqrt(along @ (single - cross - cross.T) @ along) / length
        rows.append((length - np.linalg.norm(truth[pair.second] - truth[pair.first]) / scale) / sigma)
    return np.array(rows)
