"""The plan of the stage: jobs that fit their functions, and what every setting changes in them or in what they make."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from small_block import FLIGHT, site

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.tasks.simulation.flight import camera_of, orientations
from orthomill.tasks.simulation.plan.simulation_jobs import survey_of
from orthomill.tasks.simulation.report.flight_report import flight_report
from orthomill.tasks.simulation.simulated_tiles import describe, survey_block
from orthomill.tasks.simulation.stage import SimulationStage
from orthomill.tasks.simulation.surveying import SurveyPoint

SMALL = {
    "seed": FLIGHT.seed,
    "frame_mm": FLIGHT.frame_mm,
    "c_mm": FLIGHT.c_mm,
    "pixel_um": FLIGHT.pixel_um,
    "scale": FLIGHT.scale,
    "base_m": FLIGHT.base_m,
    "side_overlap": FLIGHT.side_overlap,
    "strips": 2,
    "photos_per_strip": 3,
    "buildings": 20,
    "control": 5,
    "check": 4,
    "board_photos": 2,
}
VIEW = SimpleNamespace(project=SimpleNamespace(crs="EPSG:2100", tile=512))


def planned(**changes) -> list:
    return list(SimulationStage(**{**SMALL, **changes}).plan(VIEW))


@pytest.fixture(scope="module")
def plan() -> list:
    return planned()


def jobs(made: list, word: str = "") -> list[Job]:
    return [one for one in made if isinstance(one, Job) and one.item.startswith(word)]


def specs(made: list) -> dict[str, RasterSpec]:
    return {one.name: one for one in made if isinstance(one, RasterSpec)}


def test_all_jobs_fit_their_functions_and_have_names_of_their_own(plan):
    assert [misfit(job) for job in jobs(plan) if misfit(job)] == []
    assert len({one.key for one in plan if not isinstance(one, RasterSpec)}) == sum(not isinstance(one, RasterSpec) for one in plan)


def test_everything_is_planned_at_once_and_the_same_again(plan):
    assert [job.key for job in jobs(planned())] == [job.key for job in jobs(plan)]
    assert jobs(plan)[0].params["site"].flight == FLIGHT


def test_photographs_and_tables_are_exported_as_files(plan):
    files = {one.path: one.format for one in plan if isinstance(one, Export)}
    assert {path for path, kind in files.items() if kind == "csv"} == {
        f"photographs/{name}.csv" for name in ("positions", "control", "measurements")
    }
    assert sum(path.startswith("photographs/volos_") for path in files) == 6
    assert sum(path.startswith("chessboards/board_") for path in files) == 2


@pytest.mark.parametrize("cell", [0.5, 1.0, 2.0])
def test_the_cell_of_the_scene(cell):
    made = planned(scene_cell=cell)
    shape = specs(made)["truth/surface"].shape
    bounds = site().scene
    assert shape == (round((bounds.north - bounds.south) / cell), round((bounds.east - bounds.west) / cell))
    assert jobs(made, "scene")[0].params["site"].grid.cell == cell


@pytest.mark.parametrize("count", [0, 1, 5])
def test_the_number_of_photographs_of_boards(count):
    made = planned(board_photos=count)
    boards = {job.item for job in jobs(made, "board_")}
    assert boards == {f"board_{number + 1:02d}" for number in range(count)}
    assert jobs(made, "report")[0].params["boards"][0] == count


def test_boards_on_the_floor_and_noise_reach_their_photographs():
    made = planned(boards=3, noise_sigma=4.5)
    assert {(job.params["photo"].boards, job.params["photo"].noise_sigma) for job in jobs(made, "board_")} == {(3, 4.5)}
    assert {job.params["shot"][1] for job in jobs(made, "volos_")} == {4.5}


POINTS = tuple(SurveyPoint(xyz=(408000.0 + 9.0 * k, 4357000.0 - 7.0 * k, 40.0 + k), photos=(0, 1, 2)) for k in range(9))


def tables(**changes):
    (job,) = jobs(planned(**changes), "survey")
    return survey_block(POINTS, job.params["site"], job.params["settings"])


@pytest.mark.parametrize("sigma", [0.01, 0.1, 1.0])
def test_the_precision_of_control_is_that_of_the_setting(sigma):
    control = tables(control_sigma=sigma).control
    errors = np.column_stack([control.x, control.y, control.z]) - np.array([point.xyz for point in POINTS])
    assert errors.std() == pytest.approx(sigma, rel=0.4) and set(control.sigma_x) == {sigma}


@pytest.mark.parametrize("sigma", [0.02, 0.1, 2.0])
def test_the_precision_of_positions_is_that_of_the_setting(sigma):
    found = tables(gnss_sigma=sigma).positions
    errors = np.column_stack([found.x, found.y, found.z]) - np.array([o.centre for o in orientations(FLIGHT)])
    assert errors.std() == pytest.approx(sigma, rel=0.5) and set(found.sigma_z) == {sigma}


@pytest.mark.parametrize("sigma", [0.1, 1.5])
def test_the_precision_of_measurements_is_that_of_the_setting(sigma):
    small, large = (tables(image_sigma=value).measurements for value in (1e-3, sigma))
    assert (large.col - small.col).std() == pytest.approx(sigma, rel=0.35) and set(large.sigma) == {sigma}


@pytest.mark.parametrize(("control", "check"), [(5, 4), (9, 0), (0, 9)])
def test_points_are_control_first_and_then_check(control, check):
    found = tables(control=control, check=check).control
    assert found.role.tolist() == ["control"] * control + ["check"] * check
    assert len(set(found.name)) == 9 and all(name[:2] in ("CO", "CH") for name in found.name)
    assert len(jobs(planned(control=control, check=check), "place")) == 9


def test_errors_of_the_survey_depend_on_the_seed_alone():
    first, again, other = tables(), tables(), tables(seed=7)
    assert np.array_equal(first.control.x, again.control.x) and np.array_equal(first.positions.z, again.positions.z)
    assert not np.array_equal(first.control.x, other.control.x)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"strips": 8, "photos_per_strip": 5}, "strips x photos_per_strip is 40, but at most 32"),
        ({"board_photos": 0, "boards": 3}, "boards has no effect with board_photos: 0"),
        ({"control": 0, "check": 0, "control_sigma": 0.5}, "control_sigma has no effect with control: 0 and check: 0"),
        ({"control": 0, "check": 0, "control_sigma": 0.5, "image_sigma": 1.0}, "control_sigma and image_sigma have no effect"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(settings, sentence):
    with pytest.raises(ValidationError, match=sentence):
        SimulationStage(**settings)


def test_defaults_written_out_are_accepted():
    assert SimulationStage(board_photos=0, boards=5, control=0, check=0, control_sigma=0.02, image_sigma=0.3).boards == 5


def test_the_truth_is_the_block_of_the_flight():
    truth = describe(site(), "EPSG:2100")
    assert truth.grid == site().grid and truth.block.names == tuple(o.photo for o in orientations(FLIGHT))
    assert truth.block.sigma0_px == 0.0 and truth.block.camera_of("volos_1_1") == camera_of(FLIGHT)


def test_the_report_states_what_was_simulated():
    stage = SimulationStage(**SMALL)
    made = tables()
    found = flight_report(made.control, made.measurements, site(), survey_of(stage), (2, 5, 2.0))
    values = {figure.name: figure.value for figure in found.figures}
    assert values["photos"] == 6 and values["photo_width"] == 599 and values["buildings"] == 20 and values["board_photos"] == 2
    assert values["control_points"] == 5 and values["check_points"] == 4 and values["point_measurements"] == 27
    assert values["ground_pixel"] == pytest.approx(96e-6 * 6800, abs=1e-4)
    first, second = found.grids
    assert len(first.rows) == 6 and dict(second.rows)["c (px)"] == pytest.approx(camera_of(FLIGHT).c)
    (chart,) = found.charts
    assert len(chart.labels) == len(chart.x) == 6 + 9
    assert "simulated" in found.warnings[0]
