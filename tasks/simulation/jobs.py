"""The functions of the stage's jobs: each combines the modules of this folder for one tile, one table or one report."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.job import Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport, Verdict
from orthomill.schemas.truth import (
    MATERIAL_CLASSES,
    OPEN_MATERIALS,
    TRUTH_MATERIAL,
    TRUTH_ORTHO,
    TRUTH_SURFACE,
    ControlRows,
    Material,
    MeasurementRows,
    PositionRows,
)
from orthomill.tasks.simulation.boards.project_boards import CORNERS, SQUARE, BoardPhoto, render_boards
from orthomill.tasks.simulation.flight import BLOCK, FlightSettings, camera_of, exposure, orientations, true_block, views
from orthomill.tasks.simulation.rendering import Film, render
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow, painted_window
from orthomill.tasks.simulation.scene.layout import SceneSettings
from orthomill.tasks.simulation.scene.scene import SurfaceWindow, bare_ground
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.scene.true_visibility import occlusion_reach, visibility
from orthomill.tasks.simulation.scene.vehicles import vehicle_cells, vehicles_of
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


def report(
    control: ControlRows, measurements: MeasurementRows, site: Site, survey_settings: SurveySettings, boards: tuple[int, int, float]
) -> StageReport:
    """What was simulated. `boards`: photos of boards, boards on the floor, noise sigma of all photos."""
    flight = site.flight
    return StageReport(
        verdict=Verdict(level="good", sentence="The photographs are simulated, so that the truth is known."),
        aside=True,
        figures=(
            *_flight_figures(flight, boards[2]),
            *_scene_figures(site),
            _board_figure(boards[0], boards[1]),
            *_survey_figures(survey_settings, len(measurements)),
        ),
        grids=(_orientation_grid(flight), _camera_grid(flight)),
        charts=(_map(flight, control),),
        pictures=_pictures(flight),
        # Results on simulated photographs are better than on real ones: no film, no haze, no facades in detail.
        warnings=("The photographs are simulated: the results do not show how well real photographs would perform.",),
    )


def _flight_figures(flight: FlightSettings, noise_sigma: float) -> tuple[Figure, ...]:
    return (
        Figure(name="photos", value=len(views(flight)), sentence="Simulated aerial photographs."),
        Figure(name="photo_width", value=camera_of(flight).width, unit="px"),
        Figure(name="pixel_um", value=flight.pixel_um, unit="micrometres"),
        Figure(name="ground_pixel", value=round(flight.pixel_um * 1e-6 * flight.scale, 4), unit="m", sentence="On the plain."),
        Figure(name="flying_height", value=round(flight.height, 1), unit="m", sentence="Above the plain."),
        Figure(name="base", value=flight.base_m, unit="m"),
        Figure(name="noise_sigma", value=noise_sigma, unit="grey levels"),
    )


def _scene_figures(site: Site) -> tuple[Figure, ...]:
    scene, bounds = scene_of(site.scene), site.scene
    roofs = scene.buildings.eaves + scene.buildings.rise
    area = (bounds.east - bounds.west) * (bounds.north - bounds.south) / 1e4
    return (
        Figure(name="area", value=round(area, 1), unit="ha"),
        Figure(name="buildings", value=len(scene.buildings)),
        Figure(name="gabled_roofs", value=int((scene.buildings.rise > 0).sum())),
        Figure(name="highest_roof", value=round(float(roofs.max()), 1), unit="m", sentence="Absolute height."),
        Figure(name="trees", value=len(scene.trees)),
        Figure(name="vehicles_per_photo", value=len(vehicles_of(scene, 0)), sentence="In the first photo; others have as many."),
    )


def _board_figure(photos: int, boards: int) -> Figure:
    sentence = f"Of {boards} boards with {CORNERS[0]} x {CORNERS[1]} inner corners and squares of {SQUARE} m."
    return Figure(name="board_photos", value=photos, sentence=sentence)


def _survey_figures(settings: SurveySettings, measurements: int) -> tuple[Figure, ...]:
    return (
        Figure(name="gnss_sigma", value=settings.gnss_sigma, unit="m"),
        Figure(name="control_points", value=settings.control),
        Figure(name="check_points", value=settings.check),
        Figure(name="point_measurements", value=measurements, sentence=f"With sigma {settings.image_sigma} px."),
    )


def _orientation_grid(flight: FlightSettings) -> Grid:
    rows = []
    for number, view in enumerate(orientations(flight)):
        film = exposure(flight, number)
        rows.append(
            (
                view.photo,
                *(round(value, 3) for value in view.centre),
                *(round(value, 4) for value in view.omega_phi_kappa),
                round(sum(film.gain) / 3.0, 3),
                film.offset,
                film.vignetting,
            )
        )
    columns = ("photo", "X (m)", "Y (m)", "Z (m)", "omega (deg)", "phi (deg)", "kappa (deg)", "gain", "offset", "vignetting")
    return Grid(title="True exterior orientation and brightness", columns=columns, rows=tuple(rows))


def _camera_grid(flight: FlightSettings) -> Grid:
    camera = camera_of(flight)
    names = ("c (px)", "x0 (px)", "y0 (px)", "k1", "k2", "k3", "p1", "p2")
    rows = tuple(zip(names, camera.interior[: len(names)], strict=True))
    return Grid(title="True interior orientation", columns=("parameter", "value"), rows=rows)


def _map(flight: FlightSettings, control: ControlRows) -> Chart:
    centres = [view.centre for view in orientations(flight)]
    labels = (*(view.photo for view in orientations(flight)), *control.name.tolist())
    x = (*(centre[0] for centre in centres), *control.x.tolist())
    y = (*(centre[1] for centre in centres), *control.y.tolist())
    return Chart(
        title="Projection centres, control and check points",
        style="map",
        x_label="X (m)",
        y_label="Y (m)",
        x=x,
        series={"y": y},
        labels=labels,
    )


def _pictures(flight: FlightSettings) -> tuple[Picture, ...]:
    first = photo_raster_name(orientations(flight)[0].photo)
    return (
        Picture(title="A simulated photograph", raster=first, style="rgb", caption="The first one, as the pipeline receives it."),
        Picture(title="True orthoimage", raster=TRUTH_ORTHO, style="rgb", caption="No vehicles; only the evaluation reads it."),
        Picture(title="True surface", raster=TRUTH_SURFACE, style="hillshade", unit="m"),
        Picture(title="Materials", raster=TRUTH_MATERIAL, style="classes", classes=MATERIAL_CLASSES),
    )
