"""The page of the map: pictures that the stages before report, values that one can ask for, and the photographs."""

from orthomill.schemas.maps.map_page import CloudLayer, MapPage, ValueLayer
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import Picture
from orthomill.tasks.geometry.survey_system import system_name
from orthomill.tasks.viewer.photographs_on_map import map_cameras


def map_page(
    block: Block,
    photos: Photos,
    project: str,
    pictures: tuple[Picture, ...],
    values: tuple[ValueLayer, ...],
    cloud: CloudLayer | None = None,
) -> MapPage:
    """The page of a project."""
    cameras = map_cameras(block, photos)
    return MapPage(project=project, pictures=pictures, values=values, cameras=cameras, system=system_name(block.crs), cloud=cloud)
