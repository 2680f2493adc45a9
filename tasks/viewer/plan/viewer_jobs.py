"""The page of the map, and its export: layers are the pictures that the stages before report of their maps."""

from collections.abc import Iterator

from orthomill.schemas.bare_ground import (
    ABOVE_GROUND,
    CELL_CLASS,
    TERRAIN,
    TERRAIN_CODE,
    TERRAIN_CODES,
    TERRAIN_PRECISION,
    contour_sheets,
    terrain_lines_table,
)
from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.maps.map_page import MAP_PAGE, CloudLayer, ValueLayer
from orthomill.schemas.maps.map_parts import EDGES_FILE, LINES_FILE, PAGE
from orthomill.schemas.maps.straight_edges import EDGES, edge_sheets, straight_edges_table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import Picture, StageReport, report_table
from orthomill.schemas.surface import (
    CHECKED_CODE,
    CORRECTED,
    HEIGHT,
    HEIGHT_SOURCE,
    MEASURED,
    ORTHO,
    ORTHO_SOURCE,
    PRECISION,
    PROVENANCE,
    PROVENANCE_CODES,
    RELATIVE_PRECISION,
    SURFACE,
)
from orthomill.tasks.viewer.photographs_on_map import photograph_classes
from orthomill.tasks.viewer.plan.map_part_jobs import map_parts
from orthomill.tasks.viewer.report.page_of_map import map_page
from orthomill.tasks.viewer.report.viewer_report import viewer_report

_STAGES = ("densification", "dsm_check", "terrain", "texture")
"""whose pictures of maps become layers"""
_LAYERS = (
    ORTHO,
    HEIGHT,
    TERRAIN,
    ABOVE_GROUND,
    CELL_CLASS,
    RELATIVE_PRECISION,
    TERRAIN_PRECISION,
    PROVENANCE,
    TERRAIN_CODE,
    CHECKED_CODE,
    "dsm_check/dh",
    "texture/coverage",
    HEIGHT_SOURCE,
)
"""rasters in the order in which they are offered"""


def viewer_jobs(view: ProjectView) -> Iterator[Job | Export]:
    """The page of a project that has a surface or an orthoimage; none otherwise."""
    reports = tuple(view.table(report_table(kind)) for kind in _STAGES if view.has_stage(kind))
    pictures = _chosen_pictures(reports, _LAYERS)
    if any(picture.raster == ORTHO for picture in pictures):
        pictures += (_sources(view),)
    if not pictures:
        return
    values, cloud = tuple(_values(view)), _cloud(view)
    yield Job(
        stage="viewer",
        item="page",
        function=map_page,
        reads={"block": BLOCK, "photos": PHOTOS},
        writes={"page": MAP_PAGE},
        params={"project": view.project.project, "pictures": pictures, "values": values, "cloud": cloud},
    )
    parts = list(map_parts(view, pictures, values, cloud, _lines(view, reports)))
    yield from parts
    yield Export("viewer", "map", PAGE, "map", tables=(MAP_PAGE,), files=last_files(parts))
    yield Job(
        stage="viewer", item="report", function=viewer_report, reads={"page": MAP_PAGE}, writes={"report": report_table("viewer")}
    )


def last_files(parts: list[Job | Export]) -> tuple[str, ...]:
    """Files of parts that the page is made of: shades, and what no coarser part holds."""
    exports = [part for part in parts if isinstance(part, Export)]
    held = {file for part in exports if part.format == "map tiles" for file in part.files}
    return tuple(part.path for part in exports if part.format == "map shades" or part.path not in held)


def _chosen_pictures(reports: tuple[StageReport, ...], wanted: tuple[str, ...]) -> tuple[Picture, ...]:
    """The pictures of the `wanted` rasters, in that order; of several pictures of one raster the first."""
    found: dict[str, Picture] = {}
    for report in reports:
        for picture in report.pictures:
            found.setdefault(picture.raster, picture)
    return tuple(found[name] for name in wanted if name in found)


def _sources(view: ProjectView) -> Picture:
    return Picture(
        title="Photograph and time of the colours",
        raster=ORTHO_SOURCE,
        style="classes",
        classes=photograph_classes(view.table(BLOCK), view.table(PHOTOS)),
        caption="Of the photographs that are blended the one of the greatest weight; the product ortho_source.",
    )


def _values(view: ProjectView) -> Iterator[ValueLayer]:
    if view.has_stage("densification"):
        height = CORRECTED if view.has_stage("dsm_check") else HEIGHT
        rasters = {"height": height, "sigma": PRECISION, "code": PROVENANCE}
        yield ValueLayer(name="surface", title="Surface", rasters=rasters, codes=PROVENANCE_CODES)
    if view.has_stage("terrain"):
        rasters = {"height": TERRAIN, "sigma": TERRAIN_PRECISION, "code": TERRAIN_CODE}
        yield ValueLayer(name="terrain", title="Bare ground", rasters=rasters, codes=TERRAIN_CODES)


def _cloud(view: ProjectView) -> CloudLayer | None:
    if not view.has_stage("densification"):
        return None
    height = CORRECTED if view.has_stage("dsm_check") else HEIGHT
    colours = ORTHO if view.has_stage("texture") else None
    return CloudLayer(height=height, code=PROVENANCE, shown=tuple(map(int, MEASURED)), colours=colours)


def _lines(view: ProjectView, reports: tuple[StageReport, ...]) -> dict[str, tuple[Table, ...]]:
    """Tables of the lines that stages report among their products, by the file of their script."""
    made, size = {product.path for report in reports for product in report.products}, view.project.tile
    lines: dict[str, tuple[Table, ...]] = {}
    if "products/contours.gpkg" in made:
        lines[LINES_FILE] = tuple(map(terrain_lines_table, contour_sheets(view.table(SURFACE).grid.shape, size)))
    if EDGES in made:
        lines[EDGES_FILE] = tuple(map(straight_edges_table, edge_sheets(view.raster(ORTHO).shape[:2], size)))
    return lines
