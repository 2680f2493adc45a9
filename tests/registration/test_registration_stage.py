"""The stage from its files to tables, report and control of the photographs."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.orientation.scanned_site import scanned_site
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, TextFile
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromScans, MapSurface
from orthomill.tasks.catalogue import STAGES
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.control.control_system import control_from_scans
from orthomill.tasks.orientation.stage import OrientationStage
from orthomill.tasks.registration.registered_scans import register_scans
from orthomill.tasks.registration.report.registration_report import report
from orthomill.tasks.registration.stage import RegistrationStage


def rows(table):
    return "\n".join(",".join(map(str, row)) for row in table) + "\n"


def texts(site, check=2):
    """The files of a site: targets are called T0, T1, ...; the last surveyed ones are check points."""
    scans = [
        "name,x,y,z\n" + rows((f"T{i}", *xyz) for i, xyz in zip(points.point, points.xyz.tolist(), strict=True))
        for points in (site.points.take(site.points.scan == k) for k in range(site.network.scans))
    ]
    surveyed = np.flatnonzero(site.network.weight.any(axis=1))
    roles = ["control"] * (len(surveyed) - check) + ["check"] * check
    control = rows((f"T{i}", role, *site.network.control[i], *[0.002] * 3) for i, role in zip(surveyed, roles, strict=True))
    return tuple(scans), "name,role,x,y,z,sigma_x,sigma_y,sigma_z\n" + control


PATHS = tuple(f"scans/scan_{k + 1}.csv" for k in range(9))


@pytest.fixture(scope="module")
def done():
    site = scanned_site(21)
    scans, control = texts(site)
    return site, register_scans(scans, PATHS, 0.004, 4.0, control)


def test_every_scan_comes_out_with_its_place(done):
    site, tables = done
    assert [scan.name for scan in tables.scans.scans] == list(site.names)
    for scan, true in zip(tables.scans.scans, site.translation, strict=True):
        sigma = np.sqrt(np.diag(np.array(scan.covariance)))
        assert (np.abs(np.array(scan.translation) - true) < 4.0 * sigma[:3]).all()
        assert np.allclose(rotation_matrix(*np.radians(scan.omega_phi_kappa)), scan.rotation)
    assert tables.scans.datum == "control" and tables.scans.control == 6


def test_check_points_are_compared_and_take_no_part(done):
    _, tables = done
    assert [point.name for point in tables.scans.checked] == ["T6", "T7"]
    assert all(abs(d) < 4.0 * s for point in tables.scans.checked for d, s in zip(point.difference, point.sigma, strict=True))


def test_points_and_residuals_have_a_row_each(done):
    site, tables = done
    assert len(tables.residuals) == len(site.points)
    roles = dict(zip(tables.points.name.tolist(), tables.points.role.tolist(), strict=True))
    assert roles["T0"] == "control" and roles["T7"] == "check" and roles["T9"] == "tie"
    assert (tables.points.cov_xy**2 <= tables.points.sigma_x**2 * tables.points.sigma_y**2).all()


def test_the_report_tells_precision_and_rejected_targets(done):
    site, _ = done
    scans, control = texts(site)
    wrong = scans[0].replace("T", "T", 1).splitlines()
    name, x, y, z = wrong[1].split(",")
    wrong[1] = f"{name},{float(x) + 0.4},{y},{z}"
    tables = register_scans(("\n".join(wrong), *scans[1:]), PATHS, 0.004, 4.0, control)
    told = report(*tables)
    assert f"Target {name} in scan_1 contradicts the others by about 4" in told.warnings[0]
    assert {figure.name: figure.value for figure in told.figures}["rejected"] == 1
    assert told.verdict.level == "good" and {grid.title for grid in told.grids} >= {"Registered scans", "Largest residuals"}


def test_wrong_statements_are_doubts(done):
    site, _ = done
    scans, control = texts(site)
    told = report(*register_scans(scans, PATHS, 0.001, 4.0, control))
    assert told.verdict.level == "fair" and "Targets agree 3.9 times worse" in told.doubts[0]


def test_names_that_never_meet_are_told(done):
    scans, control = texts(done[0])
    with pytest.raises(WorkflowError, match="None of the 8 control points is in a scan"):
        register_scans(scans, PATHS, 0.004, 4.0, control.replace("T", "P"))
    with pytest.raises(WorkflowError, match="Two scans have the same name"):
        register_scans(scans, ("a/s.csv", "b/s.csv", *PATHS[2:]), 0.004, 4.0, control)


def test_the_stage_reads_its_files_and_writes_products():
    stage = RegistrationStage(paths=("a.csv", "b.csv"), points="control.csv", sigma=0.01, rejection=3.5)
    items = list(stage.plan(SimpleNamespace()))
    job = next(item for item in items if isinstance(item, Job))
    assert job.reads == {"texts": (TextFile("a.csv"), TextFile("b.csv")), "surveyed": TextFile("control.csv")}
    assert job.params == {"paths": ("a.csv", "b.csv"), "sigma": 0.01, "rejection": 3.5}
    assert {item.path for item in items if isinstance(item, Export)} == {
        "products/scans.json",
        "products/registered_points.csv",
        "products/scan_residuals.csv",
    }


def test_the_photographs_take_their_control_from_the_scans(done):
    _, tables = done
    photos = Photos(
        photos=tuple(
            Photo(name=n, path=f"in/{n}.jpg", width=100, height=80, bands=3, dtype="uint8", camera="c") for n in ("a", "b")
        )
    )
    source = ControlFromScans(kind="scans", measurements="m.csv", check=("T9",), absent="skip")
    measured = "name,photo,col,row,sigma\nT1,a,10,20,1\nT1,b,11,20,1\nT9,a,30,40,1\nT9,z.jpg,3,4,1\n"
    control = control_from_scans(photos, tables.points, measured, source, "EPSG:2100")
    place = tables.points.name.tolist().index("T1")
    found = {point.name: point for point in control.points}
    assert {name: point.role for name, point in found.items()} == {"T1": "control", "T9": "check"}
    assert found["T1"].sigma[0] == pytest.approx(tables.points.sigma_x[place])
    assert found["T1"].xyz[2] == pytest.approx(tables.points.z[place])
    with pytest.raises(WorkflowError, match="T99"):
        control_from_scans(photos, tables.points, measured + "T99,a,5,5,1\n", source, "EPSG:2100")


def test_a_block_with_control_from_scans_waits_for_their_registration():
    control = ControlFromScans(kind="scans", measurements="m.csv")
    view = SimpleNamespace(project=SimpleNamespace(crs="EPSG:2100", grid=MapSurface(), control=control))
    job = next(iter(OrientationStage().plan(view)))
    assert {"registration/points.parquet", "m.csv"} <= {region.path for region in job.reads.values()}


def test_control_from_scans_without_their_registration_is_told(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "m.csv").write_text("name,photo,col,row,sigma\n")
    workflow = tmp_path / "wall.yaml"
    workflow.write_text(
        "project: wall\ncrs: EPSG:2100\nphotographs: {kind: simulated}\ncontrol: {kind: scans, measurements: in/m.csv}\n"
        "stages:\n  - kind: simulation\n  - kind: photos\n"
    )
    with pytest.raises(WorkflowError, match="no stage 'registration' is in this workflow"):
        load_workflow(workflow, STAGES)
