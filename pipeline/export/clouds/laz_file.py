"""Points as one LAZ file: LAS 1.4 with the classes of ASPRS."""

from pathlib import Path

import laspy

from orthomill.pipeline.export.clouds.cloud_source import CloudSource, as_points, nothing_there


def write_laz(path: Path, source: CloudSource) -> None:
    """The points as a file at `path`. Raises WorkflowError where there are none."""
    with laspy.open(path, "w", header=source.header, do_compress=True, laz_backend=laspy.LazBackend.Lazrs) as target:
        for records in source.parts():
            target.write_points(as_points(source.header, records))
        if not target.header.point_count:
            raise nothing_there()
