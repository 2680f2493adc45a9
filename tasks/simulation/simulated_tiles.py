"""What the jobs of the flight over the town do: each combines the modules of this folder for one tile or one table."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.job import Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import OPEN_MATERIALS, ControlRows, Material, MeasurementRows, PositionRows
from orthomill.tasks.simulation.boards.project_boards import BoardPhoto, render_boards
from orthomill.tasks.simulation.flight import BLOCK, FlightSettings, camera_of, exposure, true_block, views
from orthomill.tasks.simulation.rendering import Film, render
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow, painted_window
from orthomill.tasks.simulation.scene.layout import SceneSettings
from orthomill.tasks.simulation.scene.scene import SurfaceWindow, bare_ground
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.scene.true_visibility import occlusion_reach, visibility
from orthomill.tasks.simulation.scene.vehicles import vehicle_cells
from orthomill.tasks.simulation.scene.wires import MARKED, near_spans, spans_of
from orthomill.tasks.simulation.surveying import SurveyPoint, SurveySettings, find_place, positions, survey


@dataclass(frozen=True)
class Site:
    """The scene, the flight over it and the grid of its rasters: what the jobs share."""

    scene: SceneSettings
    flight: FlightSettings
    grid: MapGrid


class SceneTruth(NamedTuple):
    """The grid of the true rasters, and the block of the true orientations and camera."""

    grid: MapGrid
    block: Block


class PaintedTile(NamedTuple):
    """One tile (rows, cols) of the scene: `surface` float32 m, `material` uint8, `building` uint16, `ortho` uint8 (..., 3), and the
    bare `ground`, float32 m, also below roofs and crowns."""

    surface: np.ndarray
    material: np.ndarray
    building: np.ndarray
    ortho: np.ndarray
    ground: np.ndarray


class SurveyTables(NamedTuple):
    """GNSS positions, control and check points, and the image measurements of these."""

    positions: PositionRows
    control: ControlRows
    measurements: MeasurementRows


def photo_raster_name(photo: str) -> str:
    """uint8 (rows, cols, 3): the photograph that is exported as a file."""
    return f"simulation/photo/{photo}"


def board_raster_name(number: int) -> str:
    """uint8 (rows, cols): the photograph of the boards, its number counted from 0."""
    return f"simulation/board/{number + 1:02d}"


def place_table(number: int) -> Table[SurveyPoint]:
    """The place of one ground point."""
    return Table(f"simulation/place/{number}.json", SurveyPoint)


def describe(site: Site, crs: str) -> SceneTruth:
    """The grid of the truth, and the true block."""
    return SceneTruth(site.grid, true_block(site.flight, scene_of(site.scene), crs))


def paint(site: Site, window: Window) -> PaintedTile:
    """One tile of the scene: height, material, building and colours."""
    # The layout is drawn again in every job instead of being stored: it takes milliseconds and is kept per process.
    scene = scene_of(site.scene)
    painted = painted_window(scene, site.grid, window)
    surface = painted.surface
    ground = bare_ground(scene, *site.grid.centres(window)).astype(np.float32)
    return PaintedTile(surface.height, _marked(site, window, surface.material), surface.building, painted.colours, ground)


def _marked(site: Site, window: Window, material: np.ndarray) -> np.ndarray:
    """The materials (rows, cols) with the bare ground on which vehicles stand in some photograph, or below a wire."""
    scene, open_ground = scene_of(site.scene), np.isin(material, np.array(OPEN_MATERIALS, np.uint8))
    span = np.zeros(window.shape, np.int32)
    near_spans(span, site.grid.centres(window), spans_of(scene), MARKED)
    marked = np.where(open_ground & (span > 0), np.uint8(Material.WIRE), material)
    driven = vehicle_cells(scene, site.grid, window, len(views(site.flight)))
    return np.where(open_ground & driven, np.uint8(Material.VEHICLE), marked)


def see(surface: np.ndarray, site: Site, window: Window, wide: Window) -> np.ndarray:
    """One tile of the visibility; `surface` covers `wide`."""
    return visibility(views(site.flight), site.grid, window, wide, surface)


def sight_window(site: Site, window: Window) -> Window:
    """The cells that may hide those of `window`, aligned to the blocks of the ray traversal."""
    reach = int(np.ceil(occlusion_reach(views(site.flight), scene_of(site.scene)) / site.grid.cell))
    return window.grown(reach).reduced(BLOCK).scaled(BLOCK).clipped(site.grid.shape)


def photograph(
    surface: np.ndarray,
    material: np.ndarray,
    building: np.ndarray,
    ortho: np.ndarray,
    site: Site,
    shot: tuple[int, float],
    windows: tuple[Window, Window],
) -> np.ndarray:
    """One tile of a photograph. `shot`: number of the photo and its noise sigma; `windows`: of the photo and of the scene."""
    number, noise_sigma = shot
    pixels, ground = windows
    film = Film(exposure(site.flight, number), noise_sigma, site.flight.seed)
    painted = PaintedWindow(SurfaceWindow(surface, material, building), ortho)
    return render(scene_of(site.scene), views(site.flight)[number], film, pixels, (site.grid, ground, painted))


def photograph_boards(flight: FlightSettings, photo: BoardPhoto, pixels: Window) -> np.ndarray:
    """One tile of a photograph of the boards."""
    return render_boards(camera_of(flight), photo, pixels)


def place_point(
    surface: np.ndarray, material: np.ndarray, visible: np.ndarray, site: Site, node: tuple[float, float], window: Window
) -> SurveyPoint:
    """The place of one ground point."""
    return find_place(node, site.grid, window, (surface, material, visible))


def survey_block(places: tuple[SurveyPoint, ...], site: Site, settings: SurveySettings) -> SurveyTables:
    """The results of the survey."""
    control, measurements = survey(site.flight, settings, places)
    return SurveyTables(positions(site.flight, settings), control, measurements)
