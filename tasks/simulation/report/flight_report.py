"""The report of the flight over the town: what was photographed, from where, and what was surveyed."""

from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport, Verdict
from orthomill.schemas.truth import MATERIAL_CLASSES, TRUTH_MATERIAL, TRUTH_ORTHO, TRUTH_SURFACE, ControlRows, MeasurementRows
from orthomill.tasks.simulation.boards.project_boards import CORNERS, SQUARE
from orthomill.tasks.simulation.flight import FlightSettings, camera_of, exposure, orientations, views
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.scene.vehicles import vehicles_of
from orthomill.tasks.simulation.simulated_tiles import Site, photo_raster_name
from orthomill.tasks.simulation.surveying import SurveySettings


def flight_report(
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
