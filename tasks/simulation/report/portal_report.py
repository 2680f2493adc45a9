"""The report of the portal."""

from orthomill.schemas.stage_report import Figure, Grid, Picture, StageReport, Verdict
from orthomill.schemas.truth import TRUTH_FRONT_ORTHO, ControlRows, MeasurementRows
from orthomill.tasks.simulation.portal.portal_block import portal_camera, portal_orientations
from orthomill.tasks.simulation.portal.portal_targets import CONTROL, TARGETS
from orthomill.tasks.simulation.portal.portal_tiles import PortalSite, portal_raster


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
