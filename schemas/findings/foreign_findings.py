"""Findings about a block that another program made."""

from typing import Literal

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.finding import SpokenFinding, Vector


class LargestReconstruction(SpokenFinding):
    """Of several reconstructions in a file the largest was read."""

    code: Literal["largest_reconstruction"] = "largest_reconstruction"
    # OpenSfM writes one reconstruction per connected part, each in a system of its own: they cannot be read as one block.
    count: int
    photos: int

    @property
    def sentence(self) -> str:
        return f"The file contains {self.count} reconstructions; the largest, of {self.photos} photographs, is taken."


class PhotosUnknown(SpokenFinding):
    """The block that was read contains photographs which the project does not have."""

    code: Literal["photos_unknown"] = "photos_unknown"
    photos: tuple[str, ...]

    @property
    def sentence(self) -> str:
        return (
            f"The block that was read has {len(self.photos)} photographs which the project does not have: {some_of(self.photos)}."
        )


class BlockElsewhere(SpokenFinding):
    """A fixed block disagrees with the positions of its photographs."""

    code: Literal["block_elsewhere"] = "block_elsewhere"
    source: str
    # A vector: its direction shows whether heights, one axis or the whole reference system differ.
    offset: Vector
    """median of block minus given, m"""

    @property
    def sentence(self) -> str:
        x, y, z = self.offset
        return (
            f"The block that was read from {self.source} puts its photographs elsewhere than their positions do (median: {x:+.1f}, "
            f"{y:+.1f}, {z:+.1f} m in X, Y, Z): its coordinates are in another reference or height system than the project, or the "
            "positions are of another place."
        )


class TiePointsMisfit(SpokenFinding):
    """The project's tie points do not fit a fixed block."""

    code: Literal["tie_points_misfit"] = "tie_points_misfit"
    source: str
    rms_px: float
    factor: float
    """estimated by stated standard error"""

    @property
    def sentence(self) -> str:
        return (
            f"The project's tie points miss the orientation that was read from {self.source} by {self.rms_px:.1f} px, "
            f"{self.factor:.0f} times their standard errors: it is not that of these photographs and cameras. Look for another "
            "order or unit of the angles, other axes, a camera of other pixels, or photographs under wrong names; or let the "
            "photographs be oriented here (exterior: {kind: adjusted})."
        )


class BlockUnexamined(SpokenFinding):
    """A fixed block that no tie points check."""

    code: Literal["block_unexamined"] = "block_unexamined"
    source: str

    @property
    def sentence(self) -> str:
        return (
            f"No tie points of the project examine the orientation that was read from {self.source}: with the stage tie_points in "
            "the workflow the report would show how well it fits."
        )
