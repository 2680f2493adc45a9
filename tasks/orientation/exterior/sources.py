"""Where the exterior orientation comes from: the block adjustment of this project, or a file of another program.

A file either fixes the orientation, or gives starting values. What only a fixed orientation reads is refused with starting values:
it would be ignored in silence.
"""

from orthomill.tasks.orientation.interchange.angles_csv import read_angles
from orthomill.tasks.orientation.interchange.cameras_json import read_block
from orthomill.tasks.orientation.interchange.colmap import read_colmap
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock
from orthomill.tasks.orientation.interchange.matrices_json import read_matrices
from orthomill.tasks.orientation.interchange.opensfm import read_opensfm
from orthomill.tasks.orientation.orientation_settings import ForeignSource


def read_foreign(texts: tuple[str, ...], source: ForeignSource, crs: str) -> ForeignBlock:
    """The block of a source from the texts of its files, in their order. Raises WorkflowError."""
    # Only OpenSfM needs the CRS: its world is geographic, the others are metric already.
    if source.kind == "csv":
        return read_angles(*texts)
    if source.kind == "matrices":
        return read_matrices(*texts)
    if source.kind == "colmap":
        return read_colmap(*texts)
    if source.kind == "orthomill":
        return read_block(texts[0], crs)
    return read_opensfm(texts[0], crs, *texts[1:])
