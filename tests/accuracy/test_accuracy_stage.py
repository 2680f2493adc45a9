"""What the stage plans for each project, and what its report says of what was found."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from box_scene import block as box_block
from memory_runner import MemoryProject

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.pipeline.signing.restatement import STATED, TESTS, restated
from orthomill.schemas.accuracy.acceptance import CustomAcceptance, DeliveryFacts
from orthomill.schemas.accuracy.accuracy_statement import AccuracyStatement
from orthomill.schemas.accuracy.adjustment_statement import AdjustmentStatement
from orthomill.schemas.accuracy.point_tests import TESTED, HeightTest, PlaceTest, PointTest, PointTests
from orthomill.schemas.accuracy.promised_errors import Reliability
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Job
from orthomill.schemas.observations import CONTROL, Control, ControlPoint
from orthomill.schemas.orientation import BLOCK, DistanceResidual, GroundResidual, GroundResiduals
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import MapGrid, RasterSpec
from orthomill.schemas.surface import ORTHO, SURFACE, Surface
from orthomill.tasks.accuracy.acceptance.clauses import accepted
from orthomill.tasks.accuracy.promises.kept_promises import reliability_of
from orthomill.tasks.accuracy.report.accuracy_report import accuracy_report
from orthomill.tasks.accuracy.stage import AccuracyStage
from orthomill.tasks.accuracy.statement.point_statement import collect_tests, statement_of

GRID = MapGrid(west=0.0, north=60.0, cell=1.0, rows=60, cols=90)


def point(name, place, role="check"):
    return ControlPoint(name=name, role=role, xyz=place, sigma=(0.02, 0.02, 0.02), measurements={"absent": (1.0, 1.0, 0.5)})


class View(MemoryProject):
    """A project whose workflow has the stages `stages`."""

    stages: tuple[str, ...] = ("densification", "texture", "dsm_check", "terrain")

    @property
    def project(self):
        return SimpleNamespace(tile=self.tile, crs="EPSG:2100", project="memory", grid=SimpleNamespace(kind="map"))

    def has_stage(self, kind):
        return kind in self.stages


def planned(stages=View.stages, points=None, **settings):
    view, points = View(32), points or (point("A", (20.0, 30.0, 5.0)),)
    view.stages = stages
    view.tables = {
        BLOCK.path: box_block(),
        CONTROL.path: Control(points=points),
        SURFACE.path: Surface(grid=GRID, height_low=0.0, height_high=20.0),
        PHOTOS.path: None,
    }
    view.specs[ORTHO] = RasterSpec(name=ORTHO, shape=(120, 180, 4), dtype="uint8", chunk=32, transform=(0.5, 0, 0, 0, -0.5, 60))
    return list(AccuracyStage(**settings).plan(view))


def jobs_of(*args, **settings):
    return [thing for thing in planned(*args, **settings) if isinstance(thing, Job)]


def test_every_job_and_every_file_has_a_name_of_its_own():
    keys = [thing.key for thing in planned()]
    assert len(keys) == len(set(keys))


def test_every_check_point_has_a_job_and_jobs_fit_their_functions():
    jobs = jobs_of(points=(point("A", (20, 30, 5)), point("B", (40, 30, 5)), point("C", (50, 30, 5), "control")))
    assert [job.row for job in jobs if job.item == "point"] == [0, 1]
    assert [misfit(job) for job in jobs if misfit(job)] == []
    first = jobs[0].reads
    assert (
        len(first["heights"]) == 4
        and len(first["corrected"]) == 1
        and len(first["terrain"]) == 2
        and len(first["ortho"]) == 1
        and not first["photos"]
    )


def test_products_that_are_not_made_are_not_read():
    (job, *_) = jobs_of(stages=())
    assert not any(job.reads[name] for name in ("heights", "corrected", "terrain", "ortho", "photos"))
    (far, *_) = jobs_of(points=(point("far", (900.0, 900.0, 0.0)),))
    assert not far.reads["heights"] and not far.reads["ortho"]


def test_points_under_vegetation_and_slopes_are_settings():
    jobs = jobs_of(points=(point("V1", (20, 30, 5)), point("A", (40, 30, 5))), vegetated=("V*",), steepest=0.3)
    assert [job.params["rules"].vegetated for job in jobs if job.item == "point"] == [True, False]
    assert jobs[0].params["rules"].steepest == 0.3
    with pytest.raises(WorkflowError, match=r"No check point is called W\* \(vegetated\); they are A\."):
        jobs_of(points=(point("A", (40, 30, 5)),), vegetated=("W*",))


def test_distances_to_check_points_state_the_scale_of_the_block():
    known = {"length": 100.0, "predicted": 0.02, "second": "K"}
    rows = tuple(
        DistanceResidual(first=name, difference=d, role=role, **known)
        for name, d, role in (("A", 0.03, "check"), ("B", 0.01, "check"), ("C", 9.0, "control"))
    )
    tests = collect_tests((), GroundResiduals(distances=rows), (), 1.0)
    found = statement_of(tests).distances
    assert (found.distances, found.fit) == (2, pytest.approx(math.sqrt(5e-4)))
    assert (found.scale, found.scale_sigma) == (pytest.approx(200.0), pytest.approx(200.0))
    assert "200 ppm longer than measured" in found.sentence
    assert statement_of(PointTests()).distances is None


@pytest.mark.parametrize(
    ("differences", "contradicting", "ppm"),
    [
        ((0.01, -0.02, -3.0, 0.01), ("A2 to B2",), 0),
        ((0.01, -3.0), ("A1 to B1",), 100),
        ((-1.0, -1.0, -1.0, -1.0), (), -10000),
        ((-3.0,), (), -30000),
        ((0.01, -3.0, 2.0), (), -3300),
    ],
)
def test_a_distance_that_contradicts_all_others_is_named_and_is_no_scale(differences, contradicting, ppm):
    """One of five that was 3 m off made a block 1713 ppm too short."""
    rows = tuple(
        DistanceResidual(first=f"A{i}", second=f"B{i}", length=100.0, difference=d, predicted=0.05, role="check")
        for i, d in enumerate(differences)
    )
    found = statement_of(PointTests(distances=rows)).distances
    assert found.contradicting == contradicting and found.scale == pytest.approx(ppm, abs=1)
    assert all(f"{name} contradicts the block by -3.00 m" in found.sentence for name in contradicting)
    facts = DeliveryFacts(statement=AccuracyStatement(distances=found))
    assert bool(accepted(CustomAcceptance(kind="custom", plan=1.0), facts, "it").findings) == bool(contradicting)


def made(count=8, up=0.0, vegetated=False):
    rng = np.random.default_rng(0)
    tests = []
    for i, (x, y) in enumerate(rng.uniform(0, 1000, (count, 2))):
        z = 10 + up + rng.normal(0, 0.03)
        tests.append(
            PointTest(
                name=f"P{i}",
                surveyed=(x, y, 10.0),
                sigma=(0.01, 0.01, 0.02),
                vegetated=vegetated,
                height=HeightTest(reason=TESTED, height=z, sigma=0.03, slope=0.0, step=0.01),
                place=PlaceTest(reason=TESTED, place=(x + 0.01, y), sigma=(0.02, 0.02), photos=3, promised=(0.02, 0.02)),
            )
        )
    return PointTests(points=tuple(tests), area_km2=1.0)


BESIDE_AN_EDGE = HeightTest(reason="beside an edge", height=12.0)


def report_of(tests, ground=GroundResiduals()):  # noqa: B008
    return accuracy_report(tests, statement_of(tests), reliability_of(tests, ground), AdjustmentStatement())


def test_without_check_points_nothing_is_proved():
    report = accuracy_report(PointTests(), AccuracyStatement(), Reliability(), AdjustmentStatement())
    assert report.verdict.level == "fair" and "Nothing is proved" in report.verdict.sentence
    assert not report.evidence and not report.answers
    assert not report.verdict.weighs, "the block says it first"


def test_check_points_at_which_nothing_could_be_tested_are_not_passed_over():
    tests = PointTests(points=tuple(point.model_copy(update={"height": BESIDE_AN_EDGE, "place": None}) for point in made().points))
    verdict = report_of(tests).verdict
    assert verdict.weighs and verdict.level == "fair"
    assert "no product could be tested at any of 8 check points (mostly: beside an edge)" in verdict.sentence


def test_what_was_tested_is_told_with_its_interval_and_few_points_with_the_standards_words():
    report = report_of(made())
    assert "in height (surface, open ground) at 8 check points" in report.verdict.sentence
    assert {e.products for e in report.evidence} == {("products/dsm.tif",), ("products/ortho.tif",)}
    grid = next(g for g in report.grids if g.title == "As the standard words it")
    assert all("using ONLY 8 checkpoints" in row[1] for row in grid.rows)
    assert not report.warnings


def test_what_measuring_made_of_the_differences_in_plan_is_no_error_of_the_product():
    """Orthoimages without error, and with one of 0.3 m, at points that were marked to 0.1 m in each direction."""
    rng, held, too_good = np.random.default_rng(4), [], []
    for own in (0.0, 0.3):
        truth = math.hypot(own, 2 * 0.01)
        for _ in range(300):
            points = made(20).points
            away = np.array([own, 0.0]) + rng.normal(0, math.hypot(0.1, 0.01), (20, 2))
            places = (
                PlaceTest(reason=TESTED, place=(p.surveyed[0] + x, p.surveyed[1] + y), sigma=(0.1, 0.1), photos=3)
                for p, (x, y) in zip(points, away, strict=True)
            )
            moved = tuple(p.model_copy(update={"place": place}) for p, place in zip(points, places, strict=True))
            found = statement_of(PointTests(points=moved, area_km2=1.0)).of("horizontal")
            held.append(found.low <= truth <= found.high)
            too_good.append(found.high < math.hypot(truth, found.measuring))
    assert np.mean(held) > 0.95 and np.mean(too_good) < 0.045


def test_a_shifted_surface_is_named_and_its_promise_called_too_small():
    report = report_of(made(up=0.5))
    assert any("as a whole lies 0.5" in warning for warning in report.warnings)
    assert any("times what was promised" in warning for warning in report.warnings)
    assert report.verdict.level == "poor"


def test_one_point_that_is_far_off_is_named():
    tests = made(count=20)
    wrong = tests.points[3].model_copy(update={"surveyed": (*tests.points[3].surveyed[:2], 10.3)})
    report = report_of(tests.model_copy(update={"points": (*tests.points[:3], wrong, *tests.points[4:])}))
    (told,) = [warning for warning in report.warnings if "check point P3" in warning]
    assert "the surface is -0.28 m off" in told and "while the others fit" in told and told in report.doubts


def test_a_point_that_is_metres_off_is_named_and_not_the_promise_of_the_others():
    tests = made(count=6)
    wrong = tests.points[3].model_copy(update={"surveyed": (*tests.points[3].surveyed[:2], 15.0)})
    report = report_of(tests.model_copy(update={"points": (*tests.points[:3], wrong, *tests.points[4:])}))
    (told,) = [warning for warning in report.warnings if "check point P3" in warning]
    assert "while the others fit" in told and not any("too small here" in warning for warning in report.warnings)


def test_a_shift_that_the_datum_allows_is_told_and_no_doubt():
    tests = made(up=0.1)
    heights = (point.height.model_copy(update={"datum": 0.05}) for point in tests.points)
    points = (point.model_copy(update={"height": height}) for point, height in zip(tests.points, heights, strict=True))
    report = report_of(tests.model_copy(update={"points": tuple(points)}))
    told = [warning for warning in report.warnings if "as a whole lies 0.1" in warning]
    assert told and told[0] not in report.doubts


def test_points_under_vegetation_are_stated_apart():
    statement = statement_of(made(up=2.0, vegetated=True))
    assert statement.of("nva") is None and statement.of("vva").points == 8
    assert not statement.named, "crowns are no shift of the whole"


def test_under_vegetation_the_bare_ground_is_tested_and_not_the_crowns():
    crowns = made(up=7.0, vegetated=True).points
    ground = HeightTest(reason=TESTED, height=10.2, sigma=0.2, slope=0.0, step=0.01)
    tests = PointTests(points=tuple(point.model_copy(update={"terrain": ground}) for point in crowns), area_km2=1.0)
    statement = statement_of(tests)
    assert statement.of("vva") is None and statement.of("vva_terrain").fit == pytest.approx(0.2)
    assert "Vegetated Vertical Accuracy (VVA)" in statement.of("vva_terrain").sentence
    kinds = {kind.kind for kind in reliability_of(tests, GroundResiduals()).kinds}
    assert "bare ground under vegetation" in kinds and "surface at check points" not in kinds


def test_bare_ground_on_open_places_tells_of_the_terrain():
    ground = HeightTest(reason=TESTED, height=10.1, sigma=0.1, slope=0.0, step=0.01)
    tests = PointTests(points=tuple(p.model_copy(update={"terrain": ground}) for p in made().points), area_km2=1.0)
    evidence = {found.products: found.rmse for found in report_of(tests).evidence}
    assert evidence[("products/terrain.tif",)] == pytest.approx(np.hypot(0.1, 0.02))


def test_one_error_of_the_block_is_in_the_diagram():
    row = GroundResidual(name="a", role="check", difference=(0.1, 0.1, 0.1), predicted=(0.1, 0.2, 0.3), photos=3)
    (grid,) = (g for g in report_of(made(), GroundResiduals(points=(row,))).grids if g.title.startswith("Promised"))
    assert [r[0] for r in grid.rows] == ["surface at check points", "orthoimage at check points", "block at check points"]


@pytest.mark.parametrize(
    ("old", "new", "words"), [("", "", ""), ('"points":8', '"points":9', "does not follow"), ("{", "(", "cannot be read")]
)
def test_a_statement_that_was_changed_is_found(tmp_path, old, new, words):
    tests = made()
    (tmp_path / "products").mkdir()
    (tmp_path / TESTS).write_text(tests.model_dump_json())
    (tmp_path / STATED).write_text(
        statement_of(tests).model_dump_json().replace(old, new) if old else statement_of(tests).model_dump_json()
    )
    assert words in restated(tmp_path, statement_of) and bool(restated(tmp_path, statement_of)) == bool(words)


def test_a_run_without_a_statement_has_nothing_to_compare(tmp_path):
    assert restated(tmp_path, statement_of) == ""
