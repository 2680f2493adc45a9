"""What the report of a block is drawn from, and what has to be counted for it."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block, BlockPrecision, GroundResiduals, RelativeOrientations
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.view import block_view

CELLS = 3
"""Each photograph is divided into CELLS x CELLS areas (von Gruber) to judge the distribution of its tie points."""


@dataclass(frozen=True, eq=False)
class Facts:
    photos: Photos
    before: Cameras
    control: Control
    relative: RelativeOrientations
    block: Block
    points: GroundPoints
    image: ImageResiduals
    ground: GroundResiduals
    precision: BlockPrecision


def filled_areas(own: ImageResiduals, camera: Camera) -> int:
    """How many of the areas of a frame hold tie points."""
    col = np.clip((own.col / camera.width * CELLS).astype(int), 0, CELLS - 1)
    row = np.clip((own.row / camera.height * CELLS).astype(int), 0, CELLS - 1)
    return len(np.unique(row * CELLS + col))


def coverage(facts: Facts) -> tuple[float, float]:
    """Percent of the photographed ground (a grid at mean height under the block) that two and three photographs see."""
    height = 0.5 * (facts.block.ground_low + facts.block.ground_high)
    views = [block_view(facts.block, name) for name in facts.block.names]
    corners = np.vstack(
        [
            v.at_height(
                np.array(
                    [[0, 0], [v.camera.width - 1, 0], [0, v.camera.height - 1], [v.camera.width - 1, v.camera.height - 1]], float
                ),
                height,
            )
            for v in views
        ]
    )
    corners = corners[np.isfinite(corners).all(axis=1)]
    if not len(corners):
        return 0.0, 0.0
    x, y = (np.linspace(corners[:, k].min(), corners[:, k].max(), 60) for k in (0, 1))
    ground = np.stack([*np.meshgrid(x, y), np.full((60, 60), height)], axis=-1).reshape(-1, 3)
    count = np.sum([v.contains(v.project(ground)) for v in views], axis=0)
    seen = max(int((count >= 1).sum()), 1)
    return float(100.0 * (count >= 2).sum() / seen), float(100.0 * (count >= 3).sum() / seen)
