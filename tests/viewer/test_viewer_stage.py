"""The stage: which layers a project gives its map, what it tells of photographs, and that it waits for nothing it does not need."""

from types import SimpleNamespace

import numpy as np
from box_scene import CENTRES, block

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.bare_ground import TERRAIN
from orthomill.schemas.job import Export, Job
from orthomill.schemas.maps.map_page import MAP_PAGE
from orthomill.schemas.maps.map_parts import EDGES_FILE, LINES_FILE
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.stage_report import Picture, Product, StageReport
from orthomill.schemas.surface import CORRECTED, HEIGHT, ORTHO, ORTHO_SOURCE, SURFACE
from orthomill.tasks.viewer.photographs_on_map import photograph_classes
from orthomill.tasks.viewer.report.page_of_map import map_page
from orthomill.tasks.viewer.report.viewer_report import viewer_report
from orthomill.tasks.viewer.stage import ViewerStage


def report(*rasters: str, path: str = "") -> StageReport:
    pictures = tuple(Picture(title=name, raster=name, style="ramp") for name in rasters)
    return StageReport(pictures=pictures, products=(Product(path=path, purpose=""),) if path else ())


def taken() -> Photos:
    """Photographs of the block."""
    facts = {"width": 420, "height": 420, "bands": 3, "dtype": "uint8", "camera": "test"}
    return Photos(photos=tuple(Photo(name=name, path=name, time="2026-05-01T10:00:00", **facts) for name in CENTRES))


class View:
    """A project whose stages have reported."""

    def __init__(self, **reports: StageReport) -> None:
        self.reports = reports
        self.project = SimpleNamespace(project="site", tile=512)

    def has_stage(self, kind):
        return kind in self.reports

    def raster(self, name):
        return SimpleNamespace(shape=(6000, 3000))

    def table(self, table):
        if table == SURFACE:
            return SimpleNamespace(grid=SimpleNamespace(shape=(6000, 3000)))
        return {BLOCK: block(), PHOTOS: taken()}.get(table) or self.reports[table.path.split("/")[0]]


def planned(view: View) -> tuple[list[Job], list[Export]]:
    made = list(ViewerStage().plan(view))
    return [one for one in made if isinstance(one, Job)], [one for one in made if isinstance(one, Export)]


def test_layers_are_the_maps_that_stages_report_the_orthoimage_first():
    view = View(
        densification=report(HEIGHT, "densification/unknown"),
        terrain=report(TERRAIN, path="products/contours.gpkg"),
        texture=report(ORTHO, path="products/edges.gpkg"),
    )
    jobs, exports = planned(view)
    assert all(misfit(job) is None for job in jobs)
    assert [picture.raster for picture in jobs[0].params["pictures"]] == [ORTHO, HEIGHT, TERRAIN, ORTHO_SOURCE]
    assert {name for export in exports for name in export.rasters.values()} >= {ORTHO, HEIGHT, TERRAIN}
    assert [export.path for export in exports if MAP_PAGE in export.tables][-1] == exports[-1].path == "products/index.html"
    lines, edges = (export for export in exports if export.format == "map lines")
    assert [table.path for table in lines.tables] == [f"terrain/contours/sheet_{row}-0.parquet" for row in (0, 1)]
    assert [table.path for table in edges.tables] == [f"texture/edges/sheet_{row}-0.parquet" for row in (0, 1)]
    assert [export.path for export in (lines, edges)] == [LINES_FILE, EDGES_FILE]


def test_every_photograph_has_a_colour_its_name_and_its_time():
    nothing, *classes = photograph_classes(block(), taken())
    assert nothing == (0, "#ffffff", "no photograph") and len({colour for _, colour, _ in classes}) == len(classes)
    assert [(code, meaning) for code, _, meaning in classes] == [
        (k, f"{name}, 2026-05-01T10:00:00") for k, name in enumerate(block().names, 1)
    ]


def test_heights_of_a_place_are_those_after_the_check():
    jobs, _ = planned(View(densification=report(HEIGHT), dsm_check=report()))
    (surface,) = jobs[0].params["values"]
    assert surface.rasters["height"] == CORRECTED


def test_a_project_without_maps_has_no_page():
    assert planned(View(densification=report())) == ([], [])


def test_photographs_stand_where_they_were_taken_over_what_they_show():
    page = map_page(block(), taken(), "site", (Picture(title="a", raster="a", style="rgb"),), ())
    camera = page.cameras[0]
    assert camera.name == block().names[0] and camera.taken == "2026-05-01T10:00:00"
    assert np.ptp(np.array(camera.outline), axis=0).min() > 10
    inside = np.array(camera.outline).mean(axis=0) - np.array(camera.centre[:2])
    assert np.hypot(*inside) < 30
    assert viewer_report(page).products[0].path == "products/index.html"
