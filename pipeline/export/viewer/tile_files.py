"""The files that a part of the map leaves beside the list of its tiles."""

from pathlib import Path, PurePosixPath

from orthomill.schemas.job import Export
from orthomill.schemas.maps.map_parts import LEVELS, WrittenTiles

OF_TILES, OF_VALUES = "map tiles", "map values"
"""formats of parts"""


def tile_files(export: Export, path: Path) -> tuple[str, ...]:
    """Names in the run's folder of the tiles that the part itself wrote, from its list at `path`; none for other formats."""
    if export.format not in (OF_TILES, OF_VALUES):
        return ()
    names, folder = WrittenTiles.model_validate_json(path.read_bytes()).names, PurePosixPath(export.path).parents[1]
    if export.format == OF_VALUES:
        return tuple(f"{folder}/{name}" for found in names.values() for name in found)
    # Lists have the names of finer parts as well, which are in the records of these.
    finest = int(PurePosixPath(export.path).name.split("-")[0])
    return tuple(f"{folder}/{level}/{name}" for level in range(finest, finest + LEVELS) for name in names.get(level, ()))
