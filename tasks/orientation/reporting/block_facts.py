"""The facts from which the report of a block is made, and what has to be counted for it."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block, BlockPrecision, GroundResiduals, RelativeOrientations
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.view import View, block_view

CELLS = 3
"""Each photograph is divided into CELLS x CELLS areas (von Gruber) to judge the distribution of its tie points."""
GRID = 60
"""Places of the ground on each side of the grid: 3600 of them give a percentage to better than a percent."""


@dataclass(frozen=True, eq=False)
class Facts:
    """The tables of the stage, and the cameras as they were `before` the adjustment."""

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
    """The number of areas of a frame that contain tie points."""
    # Points on the last row and column lie at the border of the last area.
    col = np.clip((own.col / camera.width * CELLS).astype(int), 0, CELLS - 1)
    row = np.clip((own.row / camera.height * CELLS).astype(int), 0, CELLS - 1)
    return len(np.unique(row * CELLS + col))


def coverage(facts: Facts) -> tuple[float, float]:
    """Percent of the photographed ground (a grid at the mean height under the block) that two and three photographs see."""
    height = facts.block.ground_mean
    views = [block_view(facts.block, name) for name in facts.block.names]
    corners = np.vstack([view.at_height(_corners(view), height) for view in views])
    # Rays above the horizon of an oblique photograph meet no ground.
    corners = corners[np.isfinite(corners).all(axis=1)]
    if not len(corners):
        return 0.0, 0.0
    x, y = (np.linspace(corners[:, k].min(), corners[:, k].max(), GRID) for k in (0, 1))
    ground = np.stack([*np.meshgrid(x, y), np.full((GRID, GRID), height)], axis=-1).reshape(-1, 3)
    # Through the whole camera model, because a distorted border is not a straight line on the ground.
    count = np.sum([view.contains(view.project(ground)) for view in views], axis=0)
    # Of the ground that was photographed, not of the rectangle around it.
    seen = max(int((count >= 1).sum()), 1)
    return float(100.0 * (count >= 2).sum() / seen), float(100.0 * (count >= 3).sum() / seen)


def _corners(view: View) -> np.ndarray:
    """(4, 2) pixels"""
    right, bottom = view.camera.width - 1, view.camera.height - 1
    return np.array([[0, 0], [right, 0], [0, bottom], [right, bottom]], float)
