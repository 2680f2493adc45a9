"""The portal as jobs of the simulation."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from orthomill.pipeline.storage.mesh_files import read_mesh
from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.simulation.portal.portal_scene import PortalScene
from orthomill.tasks.simulation.portal.portal_tiles import (
    PortalSite,
    describe_portal,
    front_of_portal,
    photograph_of_portal,
    portal_scan,
    portal_survey,
)
from orthomill.tasks.simulation.report.portal_report import portal_report
from orthomill.tasks.simulation.stage import SimulationStage

SCENE = {"kind": "portal", "reduction": 8.0, "scan_cell": 0.25, "scan_noise": 0.002, "front_pixel": 0.05}
SITE = PortalSite(7, PortalScene(**SCENE), 1.5, 0.002, 0.25)


def planned(**settings):
    view = SimpleNamespace(project=SimpleNamespace(crs="EPSG:3857", tile=128))
    return list(SimulationStage(**settings).plan(view))


def test_the_portal_is_planned_by_tiles():
    items = planned(scene=SCENE, seed=7, noise_sigma=1.5, control_sigma=0.002, image_sigma=0.25)
    jobs = [item for item in items if isinstance(item, Job)]
    assert {job.params["site"] for job in jobs} == {SITE}
    assert sum(job.item == "portal_3" for job in jobs) == 3 * 2 and sum(job.item == "front" for job in jobs) == 1
    specs = {item.name: item.shape for item in items if isinstance(item, RasterSpec)}
    assert specs["simulation/photo/portal_1"] == (243, 324, 3) and specs["truth/front/depth"] == (120, 120)
    assert {item.path for item in items if isinstance(item, Export)} >= {"photographs/portal_7.tif", "photographs/scan.ply"}
    assert len({item.key for item in items if not isinstance(item, RasterSpec)}) == sum(
        not isinstance(item, RasterSpec) for item in items
    )


def test_settings_of_a_flight_are_refused():
    with pytest.raises(ValidationError, match="base_m has no effect with scene"):
        SimulationStage(scene=SCENE, base_m=100)


def test_jobs_give_photographs_truth_and_survey():
    tile = photograph_of_portal(SITE, 4, Window(100, 100, 30, 40))
    assert tile.shape == (30, 40, 3) and tile.std() > 5
    front = front_of_portal(SITE, Window(40, 40, 32, 32))
    assert front.ortho.std() > 5 and np.isfinite(front.depth).all()
    assert np.bitwise_count(front.visible).mean() > 3
    truth = describe_portal(SITE, "EPSG:3857")
    assert truth.grid.shape == (120, 120) and len(truth.block.photos) == 7
    told = portal_report(*portal_survey(SITE), SITE)
    assert {figure.name: figure.value for figure in told.figures}["photos"] == 7


def test_the_scan_is_what_a_projection_reads(tmp_path):
    surface = ProjectionStage(surface={"kind": "simulated"}).surface
    assert (surface.unit, surface.shift, surface.faces) == ("m", (0.0, 0.0, 0.0), "auto")
    (tmp_path / "scan.ply").write_text(portal_scan(SITE).text)
    mesh = read_mesh(tmp_path / "scan.ply")
    assert len(mesh.triangles) > 1000 and np.abs(mesh.vertices.mean(axis=0) - (120, 240, 72.5)).max() < 2.0
