"""The files of the map in a browser, by the formats of their exports."""

from collections.abc import Callable
from pathlib import Path

from orthomill.pipeline.export.viewer.layer_parts import write_shades, write_tiles
from orthomill.pipeline.export.viewer.line_script import write_lines
from orthomill.pipeline.export.viewer.point_cloud_script import write_cloud
from orthomill.pipeline.export.viewer.value_tiles import write_values
from orthomill.pipeline.export.viewer.viewer_page import write_page
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.job import Export

MAP_WRITERS: dict[str, Callable[[Export, ReadableStore, Path], None]] = {
    "map": write_page,
    "map shades": write_shades,
    "map tiles": write_tiles,
    "map values": write_values,
    "map points": write_cloud,
    "map lines": write_lines,
}
