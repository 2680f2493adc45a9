"""The jobs of the stage `simulation`: the scene, its photographs, the chessboards and the survey."""

from collections.abc import Iterator

from orthomill.schemas.job import Export, Job, Raster, Region, Table
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.raster import MapGrid, RasterSpec, map_raster, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.truth import (
    CONTROL_TABLE,
    MEASUREMENTS_TABLE,
    POSITIONS_TABLE,
    TRUTH_BLOCK,
    TRUTH_BUILDING,
    TRUTH_GRID,
    TRUTH_GROUND,
    TRUTH_MATERIAL,
    TRUTH_ORTHO,
    TRUTH_READERS,
    TRUTH_SURFACE,
    TRUTH_VISIBILITY,
)
from orthomill.tasks.simulation.boards.project_boards import BoardPhoto
from orthomill.tasks.simulation.flight import FlightSettings, camera_of, scene_grid, scene_settings, seen_window, views
from orthomill.tasks.simulation.plan.portal_jobs import plan_portal
from orthomill.tasks.simulation.portal.portal_tiles import PortalSite
from orthomill.tasks.simulation.report.flight_report import flight_report
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.simulated_tiles import (
    Site,
    board_raster_name,
    describe,
    paint,
    photo_raster_name,
    photograph,
    photograph_boards,
    place_point,
    place_table,
    see,
    sight_window,
    survey_block,
)
from orthomill.tasks.simulation.stage import SimulationStage
from orthomill.tasks.simulation.surveying import SurveySettings, lattice, search_window

_PLACE = {"surface": TRUTH_SURFACE, "material": TRUTH_MATERIAL, "visible": TRUTH_VISIBILITY}
_SURVEY: dict[str, Table] = {"positions": POSITIONS_TABLE, "control": CONTROL_TABLE, "measurements": MEASUREMENTS_TABLE}
_SCENE = {"surface": TRUTH_SURFACE, "material": TRUTH_MATERIAL, "building": TRUTH_BUILDING, "ortho": TRUTH_ORTHO}
"""what photographs are rendered from"""
_PAINTED = {**_SCENE, "ground": TRUTH_GROUND}


def simulation_jobs(asked: SimulationStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """The truth, the photographs, the boards and the survey; nothing depends on a table that has to exist first."""
    if asked.scene.kind == "portal":
        portal = PortalSite(asked.seed, asked.scene, asked.noise_sigma, asked.control_sigma, asked.image_sigma)
        yield from plan_portal(portal, view.project.crs, view.project.tile)
        return
    site, crs, tile = site_of(asked), view.project.crs, view.project.tile
    yield Job(
        stage="simulation",
        item="truth",
        function=describe,
        reads={},
        writes={"grid": TRUTH_GRID, "block": TRUTH_BLOCK},
        params={"site": site, "crs": crs},
    )
    yield from _plan_scene(asked, site, crs, tile)
    yield from _plan_photos(asked, site, tile)
    yield from _plan_boards(asked, site, tile)
    yield from _plan_survey(asked, site)


def flight_of(asked: SimulationStage) -> FlightSettings:
    """Camera and flight plan."""
    return FlightSettings(
        seed=asked.seed,
        frame_mm=asked.frame_mm,
        c_mm=asked.c_mm,
        pixel_um=asked.pixel_um,
        scale=asked.scale,
        base_m=asked.base_m,
        side_overlap=asked.side_overlap,
        strips=asked.strips,
        photos_per_strip=asked.photos_per_strip,
    )


def survey_of(asked: SimulationStage) -> SurveySettings:
    """Numbers and precisions of the survey."""
    return SurveySettings(asked.control, asked.check, asked.control_sigma, asked.gnss_sigma, asked.image_sigma)


def site_of(asked: SimulationStage) -> Site:
    """The scene, the flight over it, and the grid of its rasters."""
    scene = scene_settings(flight_of(asked), asked.buildings, asked.scene.wood if asked.scene.kind == "town" else 0.0)
    return Site(scene, flight_of(asked), scene_grid(scene, asked.scene_cell))


def _plan_scene(asked: SimulationStage, site: Site, crs: str, tile: int) -> Iterator[RasterSpec | Job]:
    grid = site.grid
    yield from _truth_rasters(grid, crs, tile)
    for t in tiles_of(grid.shape, tile):
        writes: dict[str, Raster | Table] = {key: Raster(name, t.window) for key, name in _PAINTED.items()}
        yield Job(
            stage="simulation",
            item="scene",
            function=paint,
            reads={},
            writes=writes,
            params={"site": site, "window": t.window},
            row=t.row,
            col=t.col,
            # The halo of the shadows, and the mosaic of real photographs with its mean.
            scratch=array_bytes(90, t.window.height + 100, t.window.width + 100) + 70 * MIB,
        )
    yield from _plan_visibility(asked, site, tile)


def _plan_visibility(asked: SimulationStage, site: Site, tile: int) -> Iterator[Job]:
    for t in tiles_of(site.grid.shape, tile):
        wide = sight_window(site, t.window)
        yield Job(
            stage="simulation",
            item="visibility",
            function=see,
            reads={"surface": Raster(TRUTH_SURFACE, wide)},
            writes={"visibility": Raster(TRUTH_VISIBILITY, t.window)},
            params={"site": site, "window": t.window, "wide": wide},
            row=t.row,
            col=t.col,
            scratch=array_bytes(16, wide),
        )


def _plan_photos(asked: SimulationStage, site: Site, tile: int) -> Iterator[RasterSpec | Job | Export]:
    scene = scene_of(site.scene)
    for number, photo in enumerate(views(flight_of(asked))):
        name = photo_raster_name(photo.name)
        shape = (photo.camera.height, photo.camera.width, 3)
        yield RasterSpec(name=name, shape=shape, dtype="uint8", chunk=tile)
        for t in tiles_of(shape, tile):
            ground = seen_window(photo, scene, site.grid, t.window)
            # Its ground is known from the true orientation: a tile waits for the tiles of the scene that it shows only.
            reads: dict[str, Region | tuple[Region, ...]] = {key: Raster(raster, ground) for key, raster in _SCENE.items()}
            params = {"site": site, "shot": (number, asked.noise_sigma), "windows": (t.window, ground)}
            yield Job(
                stage="simulation",
                item=photo.name,
                function=photograph,
                reads=reads,
                writes={"photo": Raster(name, t.window)},
                params=params,
                row=t.row,
                col=t.col,
                scratch=array_bytes(52, ground) + array_bytes(28, t.window),
            )
        yield Export("simulation", f"{photo.name}_file", f"photographs/{photo.name}.tif", "tiff", {"image": name})


def _plan_boards(asked: SimulationStage, site: Site, tile: int) -> Iterator[RasterSpec | Job | Export]:
    camera = camera_of(flight_of(asked))
    for number in range(asked.board_photos):
        name, shape = board_raster_name(number), (camera.height, camera.width)
        photo = BoardPhoto(number, asked.boards, asked.seed, asked.noise_sigma)
        yield RasterSpec(name=name, shape=shape, dtype="uint8", chunk=tile)
        for t in tiles_of(shape, tile):
            yield Job(
                stage="simulation",
                item=f"board_{number + 1:02d}",
                function=photograph_boards,
                reads={},
                writes={"photo": Raster(name, t.window)},
                params={"flight": flight_of(asked), "photo": photo, "pixels": t.window},
                row=t.row,
                col=t.col,
                scratch=array_bytes(12, t.window),
            )
        file = f"chessboards/board_{number + 1:02d}.tif"
        yield Export("simulation", f"board_{number + 1:02d}_file", file, "tiff", {"image": name})


def _plan_survey(asked: SimulationStage, site: Site) -> Iterator[Job | Export]:
    places = []
    for number, node in enumerate(lattice(flight_of(asked), asked.control + asked.check)):
        window = search_window(site.grid, node)
        reads: dict[str, Region | tuple[Region, ...]] = {key: Raster(name, window) for key, name in _PLACE.items()}
        places.append(place_table(number))
        yield Job(
            stage="simulation",
            item="place",
            function=place_point,
            reads=reads,
            writes={"place": places[-1]},
            params={"site": site, "node": node, "window": window},
            row=number,
        )
    yield Job(
        stage="simulation",
        item="survey",
        function=survey_block,
        reads={"places": tuple(places)},
        writes={**_SURVEY},
        params={"site": site, "settings": survey_of(asked)},
    )
    for name, table in _SURVEY.items():
        yield Export("simulation", name, f"photographs/{name}.csv", "csv", tables=(table,))
    yield _report_job(asked, site)


def _report_job(asked: SimulationStage, site: Site) -> Job:
    return Job(
        stage="simulation",
        item="report",
        function=flight_report,
        reads={"control": CONTROL_TABLE, "measurements": MEASUREMENTS_TABLE},
        writes={"report": report_table("simulation")},
        params={"site": site, "survey_settings": survey_of(asked), "boards": (asked.board_photos, asked.boards, asked.noise_sigma)},
    )


def _truth_rasters(grid: MapGrid, crs: str, tile: int) -> Iterator[RasterSpec]:
    yield map_raster(TRUTH_SURFACE, grid, "float32", crs, tile, unit="m", readers=TRUTH_READERS)
    yield map_raster(TRUTH_GROUND, grid, "float32", crs, tile, unit="m", readers=TRUTH_READERS)
    yield map_raster(TRUTH_MATERIAL, grid, "uint8", crs, tile, readers=TRUTH_READERS)
    yield map_raster(TRUTH_BUILDING, grid, "uint16", crs, tile, readers=TRUTH_READERS)
    yield map_raster(TRUTH_ORTHO, grid, "uint8", crs, tile, bands=3, readers=TRUTH_READERS)
    yield map_raster(TRUTH_VISIBILITY, grid, "uint32", crs, tile, readers=TRUTH_READERS)
