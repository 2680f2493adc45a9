"""A block that starts with the approximate exterior orientation of a file, and is then adjusted like any other."""

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.observations import Control, TiePoints
from orthomill.schemas.orientation import RelativeOrientations
from orthomill.schemas.photo import Photos
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices
from orthomill.tasks.orientation.exterior.fixed_block import placed_block
from orthomill.tasks.orientation.exterior.sources import read_foreign
from orthomill.tasks.orientation.interchange.foreign_block import upright_block
from orthomill.tasks.orientation.orientation_settings import ForeignSource
from orthomill.tasks.orientation.results.block_tables import BlockTables
from orthomill.tasks.orientation.sources.elevation_model import Lattice


def orient_from(
    photos: Photos,
    cameras: Cameras,
    tie_points: TiePoints,
    control: Control,
    relative: RelativeOrientations,
    texts: tuple[str, ...],
    crs: str,
    choices: BlockChoices,
    source: ForeignSource,
    heights: np.ndarray | None = None,
    lattice: Lattice | None = None,
) -> BlockTables:
    """The tables of `orient_block`, started from a foreign block; `texts`: the files of `source`. Photographs that the files lack
    join by their tie points; the cameras are the project's own.

    Raises WorkflowError for the files, GeometryError where the tie points contradict the start or do not determine the block.
    """
    # Adjusted like any other block from here on: the file gives places to start from and no weights.
    start = placed_block(upright_block(read_foreign(texts, source, crs), photos), photos, cameras, source)
    return orient_block(photos, cameras, tie_points, control, relative, crs, choices, start.poses, heights, lattice)
