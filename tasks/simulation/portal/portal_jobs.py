"""The jobs of the portal: photographs and truth by tiles, the survey, the scan, the report; and the plan of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.job import Export, Job, Raster, Reading, Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, RasterSpec, Window, tiles_of
from orthomill.schemas.stage_report import Figure, Grid, Picture, StageReport, Verdict, report_table
from orthomill.schemas.truth import (
    CONTROL_TABLE,
    MEASUREMENTS_TABLE,
    TRUTH_BLOCK,
    TRUTH_FRONT_DEPTH,
    TRUTH_FRONT_GRID,
    TRUTH_FRONT_ORTHO,
    TRUTH_FRONT_VISIBILITY,
    TRUTH_READERS,
    ControlRows,
    MeasurementRows,
)
from orthomill.tasks.simulation.portal.portal_block import portal_block, portal_camera, portal_orientations, portal_views
from orthomill.tasks.simulation.portal.portal_rendering import front_orthoimage, lit_scene, photograph_portal, sees
from orthomill.tasks.simulation.portal.portal_scene import PortalScene
from orthomill.tasks.simulation.portal.portal_survey import ScanText, scan_text, scanned_portal, survey_portal
from orthomill.tasks.simulation.portal.portal_targets import CONTROL, TARGETS

SCAN_TEXT = Table("simulation/scan.json", ScanText)
FRONT = (-3.0, 6.0, 6.0, 6.0)
"""m along the facade and upwards: left edge, upper edge, width and height of the true front orthoimage"""
_SCENE_BYTES = 120 * 2**20


@dataclass(frozen=True)
class PortalSite:
    """What the jobs share."""

    seed: int
    scene: PortalScene
    noise_sigma: float
    control_sigma: float
    image_sigma: float

    @property
    def front(self) -> MapGrid:
        """The plane of the facade: x along it, y upwards, m from the middle of the door."""
        west, north, wide, high = FRONT
        cell = self.scene.front_pixel
        return MapGrid(west=west, north=north, cell=cell, rows=round(high / cell), cols=round(wide / cell))


class PortalTruth(NamedTuple):
    """The true block, and the grid of the front orthoimage."""

    block: Block
    grid: MapGrid


class FrontTile(NamedTuple):
    """A tile of the true front orthoimage: `ortho` uint8 (rows, cols, 3), `depth` float32 m before the facade, `visible` uint32:
    one bit per photograph that sees the place (people and leaves apart)."""

    ortho: np.ndarray
    depth: np.ndarray
    visible: np.ndarray


class PortalSurvey(NamedTuple):
    """Surveyed targets and their measurements."""

    control: ControlRows
    measurements: MeasurementRows


def describe_portal(site: PortalSite, crs: str) -> PortalTruth:
    """The truth that is no raster."""
    return PortalTruth(portal_block(crs, site.scene.reduction), site.front)


def photograph_of_portal(site: PortalSite, number: int, window: Window) -> np.ndarray:
    """One tile of a photograph."""
    view = portal_views(site.scene.reduction)[number]
    return photograph_portal(view, number, site.seed, site.noise_sigma, window)


def front_of_portal(site: PortalSite, window: Window) -> FrontTile:
    """One tile of the true front orthoimage."""
    grid = site.front
    light, depth = front_orthoimage(grid, window, site.seed)
    x, z = grid.centres(window)
    there = np.isfinite(depth)
    xz = np.stack(np.broadcast_arrays(x[None, :], z[:, None]), axis=2)[there]
    # A tenth of a millimetre before the surface, which would hide its own points by rounding.
    places = np.column_stack([xz[:, 0], -depth[there] - 1e-4, xz[:, 1]])
    visible = np.zeros(window.shape, np.uint32)
    for number, view in enumerate(portal_views(site.scene.reduction)):
        visible[there] |= sees(lit_scene(), view, places).astype(np.uint32) << np.uint32(number)
    return FrontTile(np.clip(light + 0.5, 0, 255).astype(np.uint8), depth, visible)


def portal_survey(site: PortalSite) -> PortalSurvey:
    """The survey of the targets."""
    return PortalSurvey(*survey_portal(site.seed, site.scene.reduction, (site.control_sigma, site.image_sigma)))


def portal_scan(site: PortalSite) -> ScanText:
    """The scanned mesh."""
    return scan_text(scanned_portal(site.seed, site.scene.scan_cell, site.scene.scan_noise))


def portal_raster(name: str) -> str:
    """The photograph that is exported as a file."""
    return f"simulation/photo/{name}"


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
        scratch=_SCENE_BYTES + 600 * triangles,
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
        scratch = _SCENE_BYTES + 120 * t.window.cells
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
        scratch = _SCENE_BYTES + 40 * t.window.cells
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


def portal_report(control: ControlRows, measurements: MeasurementRows, site: PortalSite) -> StageReport:
    """What was simulated."""
    camera = portal_camera(site.scene.reduction)
    rows = tuple(
        (view.photo, *(round(v, 4) for v in view.centre), *(round(v, 4) for v in view.omega_phi_kappa))
        for view in portal_orientations()
    )
    names = ("c (px)", "x0 (px)", "y0 (px)", "k1", "k2", "k3", "p1", "p2")
    first = portal_raster(portal_orientations()[0].photo)
    return StageReport(
        verdict=Verdict(level="good", sentence="The photographs are simulated, so that the truth is known."),
        aside=True,
        figures=(
            Figure(name="photos", value=len(rows), sentence="Simulated photographs of the entrance of a church."),
            Figure(name="photo_width", value=camera.width, unit="px"),
            Figure(name="control_points", value=CONTROL, sentence=f"Signalised, surveyed to {1000 * site.control_sigma:g} mm."),
            Figure(name="check_points", value=len(TARGETS) - CONTROL),
            Figure(name="point_measurements", value=len(measurements), sentence=f"With sigma {site.image_sigma} px."),
            Figure(name="scan_noise", value=1000 * site.scene.scan_noise, unit="mm", sentence="Of the scanned mesh."),
            Figure(name="noise_sigma", value=site.noise_sigma, unit="grey levels"),
        ),
        grids=(
            Grid(
                title="True exterior orientation",
                columns=("photo", "X (m)", "Y (m)", "Z (m)", "omega (deg)", "phi (deg)", "kappa (deg)"),
                rows=rows,
            ),
            Grid(
                title="True interior orientation",
                columns=("parameter", "value"),
                rows=tuple(zip(names, camera.interior[: len(names)], strict=True)),
            ),
        ),
        pictures=(
            Picture(title="A simulated photograph", raster=first, style="rgb", caption="The first one, as the pipeline gets it."),
            Picture(title="True front orthoimage", raster=TRUTH_FRONT_ORTHO, style="rgb", caption="Without people and leaves."),
        ),
        warnings=("The photographs are simulated: the results do not show how well real photographs would perform.",),
    )
