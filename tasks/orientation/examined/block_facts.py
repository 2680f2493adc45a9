"""The facts from which the report of a block is made, and what has to be counted for it."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.control_findings import HeightsAllZero, HeightsOfTwoSystems, HeightsUnknown
from orthomill.schemas.findings.datum_findings import DatumMisfit, NoDatum
from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block, BlockPrecision, GroundResiduals, RelativeOrientations
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.survey_system import vertical_name

CAMERAS_SHOWN = 12
"""A report with tables and charts of more cameras is not read."""
CELLS = 3
"""Each photograph is divided into CELLS x CELLS areas (von Gruber) to judge the distribution of its tie points."""


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

    @property
    def shown_cameras(self) -> dict[str, Camera]:
        """The cameras that the report shows one by one; a block may have one for every photograph."""
        return dict(list(self.block.cameras.items())[:CAMERAS_SHOWN])

    @property
    def heights(self) -> str | None:
        """What the heights of the block count from: what the system says, or else the positions where these hold it; None: nothing
        tells."""
        if stated := vertical_name(self.block.crs):
            return stated
        positions, raised = (
            self.photos.heights,
            any(isinstance(f, HeightsOfTwoSystems) and f.shift_m for f in self.control.findings),
        )
        held = any(point.role == "control" for point in self.control.points) and not raised
        return positions.system if positions and not positions.unknown and not held else None

    @property
    def without_datum(self) -> bool:
        """Whether the block is a free network: it has no place, and which way is up is arbitrary."""
        return any(isinstance(finding, NoDatum) for finding in self.precision.findings)

    def given_camera(self, name: str) -> Camera:
        """A camera of the block as it was given; that of its photograph, where the block made it for this one."""
        camera = self.block.cameras[name]
        if name in self.before.cameras or camera.source != "block":
            return self.before.cameras.get(name, camera)
        return self.before.of(next(photo for photo, own in self.block.of_photo.items() if own == name))


def heights_missing(control: Control) -> bool:
    """Whether no control point has a height: that control and the shape of the block disagree is then the same fact."""
    of_zero = any(isinstance(finding, HeightsAllZero) and not finding.freed for finding in control.findings)
    return of_zero or any(isinstance(finding, HeightsUnknown) and finding.alone for finding in control.findings)


def told_findings(control: Control, precision: BlockPrecision) -> tuple[BlockFinding, ...]:
    """The findings of the adjustment, less those that a finding about the control explains."""
    if not heights_missing(control):
        return precision.findings
    return tuple(finding for finding in precision.findings if not isinstance(finding, DatumMisfit))


def filled_areas(own: ImageResiduals, camera: Camera) -> int:
    """The number of areas of a frame that contain tie points."""
    # Points on the last row and column lie at the border of the last area.
    col = np.clip((own.col / camera.width * CELLS).astype(int), 0, CELLS - 1)
    row = np.clip((own.row / camera.height * CELLS).astype(int), 0, CELLS - 1)
    return len(np.unique(row * CELLS + col))
