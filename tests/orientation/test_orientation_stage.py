"""The stage plans what it should, from every source of control."""

from types import SimpleNamespace

import pytest
from box_scene import block
from pydantic import ValidationError

from orthomill.pipeline.engine.fingerprint import digest, of_value
from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.job import Export, Job, Table, TextFile
from orthomill.schemas.observations import TIE_POINT_COUNTS, TiePointCounts
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.project import ControlFromFiles, MapSurface, NoControl, SimulatedControl
from orthomill.tasks.orientation.exterior.fixed_block import orient_fixed
from orthomill.tasks.orientation.exterior.started_block import orient_from
from orthomill.tasks.orientation.stage import OrientationStage

FILES = ControlFromFiles(kind="files", points="in/points.csv", measurements="in/measured.csv")


ONE = Photo(name="a", path="a", width=9, height=9, bands=3, dtype="uint8", camera="c", position=(500.0, 900.0, 50.0))
KNOWN = {TIE_POINT_COUNTS: TiePointCounts(points=500, rays=2000), PHOTOS: Photos(photos=(ONE,))}
"""what the stage knows of the tie points and the photographs when it plans"""


def planned(control, **settings):
    project = SimpleNamespace(crs="EPSG:2100", grid=MapSurface(), control=control)
    view = SimpleNamespace(project=project, run_file=lambda path: f"runs/volos/{path}", table=KNOWN.get)
    return list(OrientationStage(**settings).plan(view))


@pytest.mark.parametrize(
    ("control", "files"),
    [
        (NoControl(kind="none"), []),
        (FILES, ["in/points.csv", "in/measured.csv"]),
        (FILES.model_copy(update={"distances": "in/d.csv"}), ["in/points.csv", "in/measured.csv", "in/d.csv"]),
        (SimulatedControl(kind="simulated"), ["runs/volos/photographs/control.csv", "runs/volos/photographs/measurements.csv"]),
    ],
)
def test_control_is_read_from_where_the_project_says(control, files):
    job = next(item for item in planned(control) if item.item == "control")
    assert sorted(region.path for region in job.reads.values() if isinstance(region, TextFile)) == sorted(files)


def test_every_table_has_one_writer_and_every_read_a_source():
    plan = planned(FILES)
    jobs = [item for item in plan if isinstance(item, Job)]
    written = [table.path for job in jobs for table in job.writes.values() if isinstance(table, Table)]
    assert len(set(written)) == len(written) == 14
    needed = {region.path for job in jobs for region in job.reads.values() if not isinstance(region, TextFile)}
    outside = {"photos/photos.json", "calibration/cameras.json", "tie_points/tie_points.parquet"}
    assert needed <= set(written) | outside
    assert [item.path for item in plan if isinstance(item, Export)] == [
        "products/cameras.json",
        "products/exterior_orientation.csv",
        "products/colmap/cameras.txt",
        "products/colmap/images.txt",
        "products/colmap/points3D.txt",
        "products/opensfm/reconstruction.json",
    ]


@pytest.mark.parametrize("has_tie_points", [True, False])
def test_a_foreign_orientation_needs_no_tie_points(has_tie_points):
    project = SimpleNamespace(crs="EPSG:2100", grid=MapSurface(), control=NoControl(kind="none"))
    view = SimpleNamespace(project=project, has_stage=lambda kind: has_tie_points, table=KNOWN.get)
    exterior = {"kind": "colmap", "cameras_path": "c.txt", "images_path": "i.txt"}
    block = next(item for item in OrientationStage(exterior=exterior).plan(view) if item.item == "block")
    assert [region.path for region in block.reads["texts"]] == ["c.txt", "i.txt"]
    assert ("tie_points" in block.reads) == has_tie_points


def test_a_foreign_orientation_may_be_a_start():
    exterior = {"kind": "csv", "path": "ori.csv", "use": "start"}
    block = next(item for item in planned(FILES, exterior=exterior) if item.item == "block")
    assert block.function is orient_from and [region.path for region in block.reads["texts"]] == ["ori.csv"]
    assert block.params["source"].path == "ori.csv" and "tie_points" in block.reads


def test_settings_of_the_workflow_reach_the_block():
    interior = {"kind": "free", "parameters": ["c", "k1"]}
    job = next(item for item in planned(FILES, interior=interior, gnss_shift="constant") if item.item == "block")
    assert job.params["choices"].interior.parameters == ("c", "k1")
    assert job.params["choices"].gnss_shift == "constant"
    job.params["choices"].model_dump_json()


@pytest.mark.parametrize("exterior", [{"kind": "adjusted"}, {"kind": "csv", "path": "ori.csv", "use": "start"}])
def test_an_elevation_model_is_read_where_the_photographs_are(exterior):
    elevation = {"path": "in/dem.tif", "sigma": 0.5, "system": "EPSG:2100+5773"}
    job = next(item for item in planned(FILES, exterior=exterior, elevation=elevation) if item.item == "block")
    read, lattice = job.reads["heights"], job.params["lattice"]
    assert (read.path, read.crs, read.system) == ("in/dem.tif", "EPSG:2100", "EPSG:2100+5773") and lattice.sigma == 0.5
    assert read.grid == lattice.grid and (read.window.height, read.window.width) == lattice.grid.shape
    assert misfit(job) is None and digest(of_value(job.params))


FIXED = {"kind": "csv", "path": "ori.csv"}
OF_THE_ADJUSTMENT = {
    "least_matches": 20,
    "interior": {"kind": "fixed"},
    "gnss_shift": "constant",
    "lever_arm": (0.1, 0.0, 0.2),
    "lever_sigma": 0.05,
    "looking": "level",
    "vertical_sigma": 2.0,
    "rejection": 3.0,
    "elevation": {"path": "dem.tif", "sigma": 0.5},
}


@pytest.mark.parametrize("name", OF_THE_ADJUSTMENT)
def test_a_fixed_orientation_refuses_what_only_an_adjustment_reads(name):
    with pytest.raises(ValidationError, match=rf"{name} has no effect with an exterior orientation that is fixed .*leave it out"):
        OrientationStage(exterior=FIXED, **{name: OF_THE_ADJUSTMENT[name]})
    for exterior in (FIXED | {"use": "start"}, {"kind": "adjusted"}):
        assert getattr(OrientationStage(exterior=exterior, **{name: OF_THE_ADJUSTMENT[name]}), name)


def test_all_settings_without_effect_are_named_at_once():
    with pytest.raises(ValidationError, match="rejection and elevation have no effect with an exterior orientation"):
        OrientationStage(exterior=FIXED, **OF_THE_ADJUSTMENT)


def test_a_workflow_with_every_default_written_down_is_accepted():
    """As a run writes it: all settings are set, to their defaults."""
    written = OrientationStage(exterior=FIXED).model_dump(mode="json")
    assert OrientationStage.model_validate(written) == OrientationStage(exterior=FIXED)


def test_every_setting_reaches_the_adjustment():
    jobs = {item.item: item for item in planned(FILES, **OF_THE_ADJUSTMENT) if isinstance(item, Job)}
    assert jobs["pairs"].params["least"] == 20
    choices = jobs["block"].params["choices"]
    assert choices.gnss_shift == "constant" and choices.interior.kind == "fixed" and choices.looking == "level"
    assert (choices.lever_arm, choices.lever_sigma) == ((0.1, 0.0, 0.2), 0.05)
    assert (choices.vertical_sigma, choices.rejection) == (2.0, 3.0)


@pytest.mark.parametrize(
    "settings", [{}, {"exterior": FIXED}, {"exterior": FIXED | {"use": "start"}}], ids=["own", "fixed", "start"]
)
@pytest.mark.parametrize("control", [NoControl(kind="none"), FILES, SimulatedControl(kind="simulated")], ids=lambda c: c.kind)
def test_every_job_fits_its_function(settings, control):
    project = SimpleNamespace(crs="EPSG:2100", grid=MapSurface(), control=control)
    view = SimpleNamespace(project=project, run_file=lambda path: path, has_stage=lambda kind: True, table=KNOWN.get)
    jobs = [item for item in OrientationStage(**settings).plan(view) if isinstance(item, Job)]
    assert {job.item for job in jobs} == {"control", "pairs", "block", "report", "products", "overlap"}
    assert [sentence for job in jobs if (sentence := misfit(job))] == []


def test_a_fixed_block_writes_no_separate_blocks():
    project = SimpleNamespace(crs="EPSG:2100", grid=MapSurface(), control=NoControl(kind="none"))
    view = SimpleNamespace(project=project, has_stage=lambda kind: True, table=KNOWN.get)
    block = next(item for item in OrientationStage(exterior=FIXED).plan(view) if item.item == "block")
    assert "separate" not in block.writes and block.function is orient_fixed


@pytest.mark.parametrize("item", ["pairs", "block"])
def test_memory_of_the_adjustment_follows_the_measurements(item):
    def scratch(rays: int) -> int:
        counts = TiePointCounts(points=rays, rays=rays)
        project = SimpleNamespace(crs="EPSG:2100", grid=MapSurface(), control=NoControl(kind="none"))
        view = SimpleNamespace(project=project, table=lambda table: counts)
        return next(job.scratch for job in OrientationStage().plan(view) if isinstance(job, Job) and job.item == item)

    few, many, more = map(scratch, (0, 10**5, 2 * 10**5))
    assert few > 0 and more - many == many - few >= 10 * 10**5


def test_the_outlines_are_those_of_the_photographs_of_the_block():
    outlines = dict(OrientationStage().outlines(SimpleNamespace(table=lambda table: block("ab"))))
    assert set(outlines) == {"a", "b"} and all(len(corners) == 4 for corners in outlines.values())
    assert outlines["a"] != outlines["b"]
