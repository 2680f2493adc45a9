"""The jobs of the portal: nothing depends on a table that has to exist first."""

from collections.abc import Iterator

from orthomill.schemas.job import Export, Job, Raster, Reading
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.raster import RasterSpec, tiles_of
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.truth import (
    CONTROL_TABLE,
    MEASUREMENTS_TABLE,
    TRUTH_BLOCK,
    TRUTH_FRONT_DEPTH,
    TRUTH_FRONT_GRID,
    TRUTH_FRONT_ORTHO,
    TRUTH_FRONT_VISIBILITY,
    TRUTH_READERS,
)
from orthomill.tasks.simulation.portal.portal_block import portal_camera, portal_orientations
from orthomill.tasks.simulation.portal.portal_tiles import (
    SCAN_TEXT,
    PortalSite,
    describe_portal,
    front_of_portal,
    photograph_of_portal,
    portal_raster,
    portal_scan,
    portal_survey,
)
from orthomill.tasks.simulation.report.portal_report import portal_report

_SCENE_BYTES = 120 * MIB
"""of the scene, which every process has once"""


def plan_portal(site: PortalSite, crs: str, tile: int) -> Iterator[RasterSpec | Job | Export]:
    """Everything about the portal; nothing depends on a table that has to exist first."""
    yield Job(
        stage="simulation",
        item="truth",
        function=describe_portal,
        reads={},
        writes={"block": TRUTH_BLOCK, "grid": TRUTH_FRONT_GRID},
        params={"site": site, "crs": crs},
    )
    yield from _plan_front(site, tile)
    for number, orientation in enumerate(portal_orientations()):
        yield from _plan_photograph(site, number, orientation.photo, tile)
    yield Job(
        stage="simulation",
        item="survey",
        function=portal_survey,
        reads={},
        writes={"control": CONTROL_TABLE, "measurements": MEASUREMENTS_TABLE},
        params={"site": site},
        scratch=_SCENE_BYTES,
    )
    yield Export("simulation", "control", "photographs/control.csv", "csv", tables=(CONTROL_TABLE,))
    yield Export("simulation", "measurements", "photographs/measurements.csv", "csv", tables=(MEASUREMENTS_TABLE,))
    triangles = int(120.0 / site.scene.scan_cell**2) * 2
    yield Job(
        stage="simulation",
        item="scan",
        function=portal_scan,
        reads={},
        writes={"scan": SCAN_TEXT},
        params={"site": site},
        scratch=_SCENE_BYTES + array_bytes(600, triangles),
    )
    yield Export("simulation", "scan_file", "photographs/scan.ply", "text", tables=(SCAN_TEXT,))
    reads: dict[str, Reading] = {"control": CONTROL_TABLE, "measurements": MEASUREMENTS_TABLE}
    yield Job(
        stage="simulation",
        item="report",
        function=portal_report,
        reads=reads,
        writes={"report": report_table("simulation")},
        params={"site": site},
    )


def _plan_front(site: PortalSite, tile: int) -> Iterator[RasterSpec | Job]:
    shape = site.front.shape
    writes = {"ortho": TRUTH_FRONT_ORTHO, "depth": TRUTH_FRONT_DEPTH, "visible": TRUTH_FRONT_VISIBILITY}
    yield RasterSpec(name=TRUTH_FRONT_ORTHO, shape=(*shape, 3), dtype="uint8", chunk=tile, readers=TRUTH_READERS)
    yield RasterSpec(name=TRUTH_FRONT_DEPTH, shape=shape, dtype="float32", chunk=tile, unit="m", readers=TRUTH_READERS)
    yield RasterSpec(name=TRUTH_FRONT_VISIBILITY, shape=shape, dtype="uint32", chunk=tile, readers=TRUTH_READERS)
    for t in tiles_of(shape, tile):
        regions = {key: Raster(name, t.window) for key, name in writes.items()}
        params = {"site": site, "window": t.window}
        scratch = _SCENE_BYTES + array_bytes(120, t.window)
        yield Job(
            stage="simulation",
            item="front",
            function=front_of_portal,
            reads={},
            writes=regions,
            params=params,
            row=t.row,
            col=t.col,
            scratch=scratch,
        )


def _plan_photograph(site: PortalSite, number: int, name: str, tile: int) -> Iterator[RasterSpec | Job | Export]:
    camera = portal_camera(site.scene.reduction)
    shape = (camera.height, camera.width, 3)
    yield RasterSpec(name=portal_raster(name), shape=shape, dtype="uint8", chunk=tile)
    for t in tiles_of(shape, tile):
        writes = {"photo": Raster(portal_raster(name), t.window)}
        params = {"site": site, "number": number, "window": t.window}
        scratch = _SCENE_BYTES + array_bytes(40, t.window)
        yield Job(
            stage="simulation",
            item=name,
            function=photograph_of_portal,
            reads={},
            writes=writes,
            params=params,
            row=t.row,
            col=t.col,
            scratch=scratch,
        )
    yield Export("simulation", f"{name}_file", f"photographs/{name}.tif", "tiff", {"image": portal_raster(name)})
