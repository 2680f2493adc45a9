"""The block as other programs read it: one text per file."""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.orientation.interchange.angles_csv import write_angles
from orthomill.tasks.orientation.interchange.colmap import write_colmap
from orthomill.tasks.orientation.interchange.foreign_block import MIRRORED, ForeignBlock, ForeignPose, file_view
from orthomill.tasks.orientation.interchange.opensfm import write_opensfm
from orthomill.tasks.orientation.interchange.pinhole_model import origin_of


class Text(BaseModel):
    """The content of a file that is exported."""

    model_config = ConfigDict(frozen=True)

    text: str


PRODUCTS = {
    "exterior_orientation.csv": "exterior_orientation.csv",
    "cameras.txt": "colmap/cameras.txt",
    "images.txt": "colmap/images.txt",
    "points3D.txt": "colmap/points3D.txt",
    "reconstruction.json": "opensfm/reconstruction.json",
}
"""What is written -> where under products/."""


def product_table(name: str) -> Table[Text]:
    """Where the text of a product is stored."""
    return Table(f"orientation/products/{name}.json", Text)


def block_products(photos: Photos, block: Block, points: GroundPoints) -> dict[str, Text]:
    """The texts by the names of PRODUCTS. Other programs get the photographs as their files are, not upright."""
    foreign = outgoing(photos, block, points)
    files = {name: photos[name].path.rpartition("/")[2] for name in block.names}
    origin = origin_of(block)
    texts = {
        "exterior_orientation.csv": write_angles(block),
        **write_colmap(foreign, files, origin, block.crs),
        "reconstruction.json": write_opensfm(foreign, files, block.crs),
    }
    return {name: Text(text=text) for name, text in texts.items()}


def outgoing(photos: Photos, block: Block, points: GroundPoints) -> ForeignBlock:
    """The block with cameras and poses of the files; photographs that EXIF mirrors stay upright, for no pose expresses a mirror."""
    poses, cameras = {}, {}
    for name in block.names:
        view = block_view(block, name)
        pose = ForeignPose(view.rotation, view.centre)
        # The view is upright already, which is how the exported file must be saved.
        mirrored = photos[name].exif_orientation in MIRRORED
        cameras[name], poses[name] = (view.camera, pose) if mirrored else file_view(photos[name], view.camera, pose)
    return ForeignBlock(poses, cameras, np.column_stack([points.x, points.y, points.z]))
