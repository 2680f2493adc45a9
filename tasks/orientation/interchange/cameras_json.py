"""The block of another project of orthomill, from its cameras.json.

The heights of its ground come along as two points below its middle: a block that is fixed needs them where there are no tie points.
"""

import numpy as np
from pydantic import ValidationError

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.orientation import Block
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose

_GROUND_POINTS = 20
"""points that stand for the heights of the ground: more than the fewest that determine its range"""


def read_block(text: str, crs: str) -> ForeignBlock:
    """The block of a cameras.json. Raises WorkflowError for another file, and for a block in another system than `crs`."""
    try:
        block = Block.model_validate_json(text)
    except ValidationError as error:
        raise WorkflowError(
            f"The block to be read is no cameras.json of orthomill ({error.errors()[0]['msg']}); name products/cameras.json of "
            f"a run."
        ) from None
    if block.crs.split("+")[0] != crs.split("+")[0]:
        raise WorkflowError(f"The block to be read is in {block.crs}, the project in {crs}; use the same reference system.")
    poses = {
        photo.photo: ForeignPose(
            rotation_matrix(*np.radians(photo.omega_phi_kappa)),
            np.array(photo.centre),
            None if photo.covariance is None else np.sqrt(np.diag(np.array(photo.covariance))),
        )
        for photo in block.photos
    }
    middle = np.mean([photo.centre for photo in block.photos], axis=0)
    heights = np.linspace(block.ground_low, block.ground_high, _GROUND_POINTS)
    points = np.column_stack([np.tile(middle[:2], (_GROUND_POINTS, 1)), heights])
    cameras = {photo.photo: block.camera_of(photo.photo) for photo in block.photos}
    return ForeignBlock(poses, cameras, points, block.sigma0_px, upright=True)
