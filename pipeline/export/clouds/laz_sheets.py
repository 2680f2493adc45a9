"""Points as a LAZ file for each sheet, in one pass over all of them."""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

import laspy
import numpy as np

from orthomill.pipeline.export.clouds.cloud_source import CloudSource, as_points
from orthomill.pipeline.export.conversions.map_sheets import Sheet
from orthomill.schemas.errors import WorkflowError

MOST_FILES = 500
"""that are open at a time: systems allow about a thousand"""


def write_laz_sheets(folder: Path, source: CloudSource, sheets: Iterable[Sheet]) -> list[Sheet]:
    """The points of each sheet as folder/NAME.laz; the sheets that have some. A point on a border belongs to the sheet to the east
    and north. Raises WorkflowError for more sheets than files can be open."""
    if len(sheets := tuple(sheets)) > MOST_FILES:
        raise WorkflowError(f"{len(sheets)} sheets of points are asked for, and {MOST_FILES} is the most; give a coarser grid.")
    header, written = source.header, {}
    with ExitStack() as stack:
        for records in source.parts():
            x, y = (records["XY"[k]] * header.scales[k] + header.offsets[k] for k in (0, 1))
            for sheet in sheets:
                west, south, east, north = sheet.area
                inside = (x >= west) & (x < east) & (y >= south) & (y < north)
                if inside.any():
                    if sheet not in written:
                        path = folder / f"{sheet.name}.laz"
                        written[sheet] = stack.enter_context(
                            laspy.open(path, "w", header=header, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
                        )
                    written[sheet].write_points(as_points(header, np.ascontiguousarray(records[inside])))
    return [sheet for sheet in sheets if sheet in written]
