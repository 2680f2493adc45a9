"""The stage `simulation`: photographs of a scene with known truth, as files that the other stages read like any others."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import model_validator

from orthomill.schemas.job import Export, Job, Raster, Region, Table
from orthomill.schemas.raster import MapGrid, RasterSpec, map_raster, tiles_of
from orthomill.schemas.settings import refuse_ignored, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
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
from orthomill.tasks.simulation.jobs import (
    Site,
    board_raster_name,
    describe,
    paint,
    photo_raster_name,
    photograph,
    photograph_boards,
    place_point,
    place_table,
    report,
    see,
    sight_window,
    survey_block,
)
from orthomill.tasks.simulation.portal.portal_jobs import PortalSite, plan_portal
from orthomill.tasks.simulation.portal.portal_scene import SceneChoice, TownScene
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.surveying import SurveySettings, lattice, search_window

_PLACE = {"surface": TRUTH_SURFACE, "material": TRUTH_MATERIAL, "visible": TRUTH_VISIBILITY}
_SURVEY: dict[str, Table] = {"positions": POSITIONS_TABLE, "control": CONTROL_TABLE, "measurements": MEASUREMENTS_TABLE}
_SCENE = {"surface": TRUTH_SURFACE, "material": TRUTH_MATERIAL, "building": TRUTH_BUILDING, "ortho": TRUTH_ORTHO}
"""what photographs are rendered from"""
_PAINTED = {**_SCENE, "ground": TRUTH_GROUND}


OF_THE_FLIGHT = (
    "pixel_um",
    "frame_mm",
    "c_mm",
    "scale",
    "base_m",
    "side_overlap",
    "strips",
    "photos_per_strip",
    "scene_cell",
    "buildings",
    "board_photos",
    "boards",
    "gnss_sigma",
    "control",
    "check",
)
"""Settings that only the flight over the town reads."""


class SimulationStage(Stage):
    """A flight over a simulated town near Volos with photographs of chessboards by the same camera, or the entrance of a church,
    and a survey, with known truth."""

    title: ClassVar[str] = "Simulated photographs"

    kind: Literal["simulation"] = "simulation"
    scene: SceneChoice = setting(TownScene(), "What is photographed.")
    seed: int = setting(2009, "Everything random follows from this number.", ge=0, le=10**6)
    pixel_um: float = setting(
        96.0, "Side of a pixel of the photographs; the scene does not depend on it.", "micrometres", ge=5, le=400
    )
    frame_mm: float = setting(230.0, "Side of the frame.", "mm", ge=20, le=300)
    c_mm: float = setting(153.353, "Camera constant.", "mm", ge=15, le=400)
    scale: float = setting(6800.0, "Denominator of the photo scale on the plain.", ge=1000, le=30000)
    base_m: float = setting(582.0, "Distance of neighbouring projection centres in a strip.", "m", gt=0)
    side_overlap: float = setting(0.6, "Overlap of neighbouring strips, as a share of the frame.", ge=0, lt=1)
    strips: int = setting(2, "Strips; every second one is flown in the opposite direction.", ge=1, le=8)
    photos_per_strip: int = setting(3, "Photographs in a strip.", ge=2, le=16)
    scene_cell: float = setting(0.5, "Cell of the height model and of the true orthoimage.", "m", ge=0.1, le=2)
    noise_sigma: float = setting(2.0, "Standard deviation of the noise of the photographs.", "grey levels", ge=0, le=20)
    buildings: int = setting(220, "Buildings in the scene.", ge=1, le=2000)
    board_photos: int = setting(12, "Photographs of the chessboards; 0 for none.", ge=0, le=48)
    boards: int = setting(5, "Equal chessboards on the floor.", ge=1, le=5)
    gnss_sigma: float = setting(0.1, "Standard error of each coordinate of a projection centre.", "m", gt=0, le=10)
    control: int = setting(8, "Ground control points.", ge=0, le=100)
    check: int = setting(8, "Check points.", ge=0, le=100)
    control_sigma: float = setting(0.02, "Standard error of each coordinate of a ground point.", "m", gt=0, le=10)
    image_sigma: float = setting(0.3, "Standard error of each image measurement of a ground point.", "px", gt=0, le=10)

    @model_validator(mode="after")
    def _fits_one_mask(self) -> "SimulationStage":
        if self.strips * self.photos_per_strip > 32:
            # The visibility raster has one bit per photograph.
            raise ValueError(
                f"strips x photos_per_strip is {self.strips * self.photos_per_strip}, but at most 32 photographs "
                "can be simulated: reduce strips or photos_per_strip"
            )
        return self

    @model_validator(mode="after")
    def _has_an_effect(self) -> "SimulationStage":
        """Raises ValueError for settings that others leave without effect."""
        if self.scene.kind == "portal":
            refuse_ignored(
                self, OF_THE_FLIGHT, "scene: {kind: portal}", "its seven photographs and targets are given: remove the line"
            )
            return self
        if self.board_photos == 0:
            refuse_ignored(self, ("boards",), "board_photos: 0", "no chessboards are simulated: remove the line")
        if self.control + self.check == 0:
            remedy = "no ground points are surveyed: remove the line"
            refuse_ignored(self, ("control_sigma", "image_sigma"), "control: 0 and check: 0", remedy)
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The truth, the photographs, the boards and the survey; nothing depends on a table that has to exist first."""
        if self.scene.kind == "portal":
            portal = PortalSite(self.seed, self.scene, self.noise_sigma, self.control_sigma, self.image_sigma)
            yield from plan_portal(portal, view.project.crs, view.project.tile)
            return
        site, crs, tile = self._site(), view.project.crs, view.project.tile
        yield Job(
            stage="simulation",
            item="truth",
            function=describe,
            reads={},
            writes={"grid": TRUTH_GRID, "block": TRUTH_BLOCK},
            params={"site": site, "crs": crs},
        )
        yield from self._plan_scene(site, crs, tile)
        yield from self._plan_photos(site, tile)
        yield from self._plan_boards(site, tile)
        yield from self._plan_survey(site)

    @property
    def flight(self) -> FlightSettings:
        """Camera and flight plan."""
        return FlightSettings(
            seed=self.seed,
            frame_mm=self.frame_mm,
            c_mm=self.c_mm,
            pixel_um=self.pixel_um,
            scale=self.scale,
            base_m=self.base_m,
            side_overlap=self.side_overlap,
            strips=self.strips,
            photos_per_strip=self.photos_per_strip,
        )

    @property
    def survey(self) -> SurveySettings:
        """Numbers and precisions of the survey."""
        return SurveySettings(self.control, self.check, self.control_sigma, self.gnss_sigma, self.image_sigma)

    def _site(self) -> Site:
        scene = scene_settings(self.flight, self.buildings, self.scene.wood if self.scene.kind == "town" else 0.0)
        return Site(scene, self.flight, scene_grid(scene, self.scene_cell))

    def _plan_scene(self, site: Site, crs: str, tile: int) -> Iterator[RasterSpec | Job]:
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
                scratch=90 * (t.window.height + 100) * (t.window.width + 100) + 70 * 2**20,
            )
        yield from self._plan_visibility(site, tile)

    def _plan_visibility(self, site: Site, tile: int) -> Iterator[Job]:
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
                scratch=16 * wide.height * wide.width,
            )

    def _plan_photos(self, site: Site, tile: int) -> Iterator[RasterSpec | Job | Export]:
        scene = scene_of(site.scene)
        for number, photo in enumerate(views(self.flight)):
            name = photo_raster_name(photo.name)
            shape = (photo.camera.height, photo.camera.width, 3)
            yield RasterSpec(name=name, shape=shape, dtype="uint8", chunk=tile)
            for t in tiles_of(shape, tile):
                ground = seen_window(photo, scene, site.grid, t.window)
                # Its ground is known from the true orientation: a tile waits for the tiles of the scene that it shows only.
                reads: dict[str, Region | tuple[Region, ...]] = {key: Raster(raster, ground) for key, raster in _SCENE.items()}
                params = {"site": site, "shot": (number, self.noise_sigma), "windows": (t.window, ground)}
                yield Job(
                    stage="simulation",
                    item=photo.name,
                    function=photograph,
                    reads=reads,
                    writes={"photo": Raster(name, t.window)},
                    params=params,
                    row=t.row,
                    col=t.col,
                    scratch=52 * ground.height * ground.width + 28 * t.window.height * t.window.width,
                )
            yield Export("simulation", f"{photo.name}_file", f"photographs/{photo.name}.tif", "tiff", {"image": name})

    def _plan_boards(self, site: Site, tile: int) -> Iterator[RasterSpec | Job | Export]:
        camera = camera_of(self.flight)
        for number in range(self.board_photos):
            name, shape = board_raster_name(number), (camera.height, camera.width)
            photo = BoardPhoto(number, self.boards, self.seed, self.noise_sigma)
            yield RasterSpec(name=name, shape=shape, dtype="uint8", chunk=tile)
            for t in tiles_of(shape, tile):
                yield Job(
                    stage="simulation",
                    item=f"board_{number + 1:02d}",
                    function=photograph_boards,
                    reads={},
                    writes={"photo": Raster(name, t.window)},
                    params={"flight": self.flight, "photo": photo, "pixels": t.window},
                    row=t.row,
                    col=t.col,
                    scratch=12 * t.window.height * t.window.width,
                )
            file = f"chessboards/board_{number + 1:02d}.tif"
            yield Export("simulation", f"board_{number + 1:02d}_file", file, "tiff", {"image": name})

    def _plan_survey(self, site: Site) -> Iterator[Job | Export]:
        places = []
        for number, node in enumerate(lattice(self.flight, self.control + self.check)):
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
            params={"site": site, "settings": self.survey},
        )
        for name, table in _SURVEY.items():
            yield Export("simulation", name, f"photographs/{name}.csv", "csv", tables=(table,))
        yield self._report_job(site)

    def _report_job(self, site: Site) -> Job:
        return Job(
            stage="simulation",
            item="report",
            function=report,
            reads={"control": CONTROL_TABLE, "measurements": MEASUREMENTS_TABLE},
            writes={"report": report_table("simulation")},
            params={"site": site, "survey_settings": self.survey, "boards": (self.board_photos, self.boards, self.noise_sigma)},
        )


def _truth_rasters(grid: MapGrid, crs: str, tile: int) -> Iterator[RasterSpec]:
    yield map_raster(TRUTH_SURFACE, grid, "float32", crs, tile, unit="m", readers=TRUTH_READERS)
    yield map_raster(TRUTH_GROUND, grid, "float32", crs, tile, unit="m", readers=TRUTH_READERS)
    yield map_raster(TRUTH_MATERIAL, grid, "uint8", crs, tile, readers=TRUTH_READERS)
    yield map_raster(TRUTH_BUILDING, grid, "uint16", crs, tile, readers=TRUTH_READERS)
    yield map_raster(TRUTH_ORTHO, grid, "uint8", crs, tile, bands=3, readers=TRUTH_READERS)
    yield map_raster(TRUTH_VISIBILITY, grid, "uint32", crs, tile, readers=TRUTH_READERS)
