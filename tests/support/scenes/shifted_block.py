"""A pair of photographs whose centres err together, and ground that both show."""

import numpy as np
from village_pair import block_of, normal_case

from orthomill.schemas.orientation import JointCovariance
from orthomill.tasks.geometry.view import block_view

COMMON = np.diag([0.04, 0.09, 0.01, 0.0, 0.0, 0.0])
"""all photographs are shifted together: m2"""


def shifted_block(joint=True):
    """A pair of photographs whose centres err together."""
    found = block_of(normal_case(420))
    rows = tuple(map(tuple, COMMON))
    photos = tuple(photo.model_copy(update={"covariance": rows}) for photo in found.photos)
    first, second = found.names[:2]
    together = (JointCovariance(first=first, second=second, covariance=rows),) if joint else ()
    return found.model_copy(update={"photos": photos, "joint": together})


def shown_places(found):
    """Two points that both photographs show."""
    left, right = (block_view(found, name) for name in found.names[:2])
    middle = 0.5 * (left.camera.width - 1), 0.5 * (left.camera.height - 1)
    pixels = np.array(middle) + np.array([[10.0, 20.0], [25.0, -15.0]])
    ground = left.at_height(pixels, 0.0)
    inside = right.contains(right.project(ground))
    assert inside.all()
    return ground
