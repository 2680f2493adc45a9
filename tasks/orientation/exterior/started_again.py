"""A block as the start of its next adjustment, with other camera constants for some of its photographs."""

import numpy as np

from orthomill.tasks.orientation.block.assembly import BlockResults
from orthomill.tasks.orientation.block.own_constants import OwnConstant
from orthomill.tasks.orientation.start.block_growth import Given, GrowthMaterial


def where_it_is(results: BlockResults, own: OwnConstant, material: GrowthMaterial) -> Given:
    """The orientations of a block, those with another constant moved back along their axes: they see the ground as large from
    there."""
    state, rays = results.result.state, results.result.rays.take(results.result.used)
    depth = np.einsum("mi,mi->m", state.rotation[rays.photo, 2], state.centre[rays.photo] - state.point[rays.point])
    rotation, centre = np.tile(np.eye(3), (len(material.names), 1, 1)), np.zeros((len(material.names), 3))
    known = np.zeros(len(material.names), bool)
    for i, name in enumerate(results.problem.names):
        number, seen = material.names.index(name), depth[rays.photo == i]
        back = (own.factor - 1.0) * float(np.median(seen)) if name in own.photos and len(seen) else 0.0
        rotation[number], centre[number] = state.rotation[i], state.centre[i] + back * state.rotation[i, 2]
        known[number] = True
    return Given(rotation, centre, known)
