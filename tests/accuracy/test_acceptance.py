"""Deliveries against profiles: every clause met, missed or not testable."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from orthomill.schemas.accuracy.acceptance import Acceptance, DeliveryFacts
from orthomill.schemas.accuracy.acceptance_record import SystemNames
from orthomill.schemas.accuracy.accuracy_statement import AccuracyStatement
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.project import Project
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.accuracy.acceptance.clauses import accepted
from orthomill.tasks.accuracy.acceptance.delivered_points import SurveyedPoint, inspected
from orthomill.tasks.accuracy.acceptance.inspector import Inspector
from orthomill.tasks.accuracy.statement.tested_accuracy import accuracy_of

IMAGE = MapGrid(west=0, north=100, cell=0.1, rows=1000, cols=1000)


def profile(**given):
    return TypeAdapter(Acceptance).validate_python(given)


def stated(rmse, points=30, survey=0.01):
    figures = [
        accuracy_of(kind, np.full((points, width), rmse / np.sqrt(width)), np.full((points, width), survey), None, 1.0)
        for kind, width in (("horizontal", 2), ("nva", 1))
    ]
    return DeliveryFacts(
        statement=AccuracyStatement(figures=tuple(figures)),
        pixel=0.1,
        voids=0.0,
        clipped=0.2,
        crs="EPSG:25832+7837",
        systems=SystemNames(height="DHHN2016 height"),
    )


def outcomes(result):
    return {clause.clause: clause.outcome for clause in result.clauses}


def test_a_delivery_that_keeps_everything_is_complete():
    result = accepted(profile(kind="asprs_2023", plan=0.1, height=0.1, clipped=1.0, heights_named=True), stated(0.05), "it")
    assert result.complete and set(outcomes(result).values()) == {"met"}
    assert "keeps all" in result.sentence


@pytest.mark.parametrize(
    ("facts", "clause", "outcome"),
    [
        (stated(0.2), "accuracy in plan", "missed"),
        (stated(0.05, points=20), "check points for height", "missed"),
        (stated(0.05, survey=0.06), "survey of the check points in height", "missed"),
        (DeliveryFacts(), "accuracy in height", "not testable"),
        (DeliveryFacts(), "pixel of the orthoimage", "not testable"),
    ],
)
def test_one_clause_that_is_not_met_makes_it_incomplete(facts, clause, outcome):
    result = accepted(profile(kind="asprs_2023", plan=0.1, height=0.1, pixel=0.2), facts, "it")
    assert outcomes(result)[clause] == outcome and not result.complete
    assert "not complete" in result.sentence


@pytest.mark.parametrize(
    ("facts", "kind", "opening"),
    [
        (stated(0.05), "asprs_2023", "This data set was tested to meet ASPRS"),
        (stated(0.05, points=20), "asprs_2023", "This data set was tested as required by ASPRS"),
        (DeliveryFacts(), "asprs_2023", "This data set was produced to meet ASPRS"),
        (stated(0.05), "custom", "This data set was tested to meet ASPRS"),
    ],
)
def test_each_accuracy_is_worded_as_the_standard_does(facts, kind, opening):
    wordings = accepted(profile(kind=kind, plan=0.18, height=0.055), facts, "it").wordings
    assert [words.kind for words in wordings] == ["horizontal", "nva"]
    assert all(words.sentence.startswith(opening) and words.tested == bool(facts.statement.figures) for words in wordings)
    if not facts.statement.figures:
        assert [words.sentence.partition("for a")[2] for words in wordings] == [
            "n 18-cm RMSE_H Horizontal Positional Accuracy Class.",
            " 5.5-cm RMSE_V Non-Vegetated Vertical Accuracy (NVA) Class.",
        ]


def test_nothing_is_declared_where_the_standard_was_not_agreed():
    assert not accepted(profile(kind="custom", plan=0.1), DeliveryFacts(), "it").wordings


def test_profiles_have_their_own_limits():
    adv = outcomes(accepted(profile(kind="adv_truedop"), stated(0.05), "it"))
    assert adv == {"accuracy in plan": "met", "pixel of the orthoimage": "met", "voids": "met"}
    inspire = outcomes(accepted(profile(kind="inspire_oi"), stated(0.21), "it"))
    assert inspire == {"accuracy in plan stated": "met", "voids": "met"}
    untested = outcomes(accepted(profile(kind="inspire_oi"), DeliveryFacts(voids=1.0), "it"))
    assert untested == {"accuracy in plan stated": "missed", "voids": "missed"}
    pixels = accepted(profile(kind="inspire_oi", plan_pixels=2.0), stated(0.21), "it")
    assert outcomes(pixels)["accuracy in plan"] == "missed" and pixels.clauses[0].limit == "0.200 m"
    with pytest.raises(ValidationError):
        profile(kind="asprs_2023", plan=-1)


@pytest.mark.parametrize(
    ("kind", "part"), [("asprs_2023", "leaves the class to those who order"), ("custom", "nothing would be tested")]
)
def test_a_profile_that_asks_for_nothing_asks_for_its_limits(kind, part):
    """Found "0 of 0 clauses missed"."""
    with pytest.raises(ValidationError, match=part):
        profile(kind=kind)
    assert profile(kind="asprs_2023", height=0.1).asks and profile(kind="custom", heights_named=True).asks


@pytest.mark.parametrize(
    ("limits", "facts", "clause", "outcome"),
    [
        ({"plan_pixels": 1.0}, stated(0.05), "accuracy in plan", "met"),
        ({"plan_stated": True}, DeliveryFacts(), "accuracy in plan stated", "missed"),
        ({"plan_pixels": 0.4}, stated(0.05), "accuracy in plan", "missed"),
        ({"height": 0.1, "survey_share": 0.5}, stated(0.05, survey=0.06), "survey of the check points in height", "missed"),
        ({"gaps": 0.5}, DeliveryFacts(gaps=0.4), "gaps of the surface", "met"),
        ({"gaps": 0.5}, DeliveryFacts(gaps=0.6), "gaps of the surface", "missed"),
        ({"area": "site.geojson"}, DeliveryFacts(covered=(("surface", 100.0),)), "area covered by the surface", "met"),
        ({"area": "a.gpkg", "covered": 95.0}, DeliveryFacts(covered=(("orthoimage", 94.0),)), None, "missed"),
        ({"area": "a.gpkg"}, DeliveryFacts(), None, "not testable"),
        ({"seams": 3.0}, DeliveryFacts(seams=4.0), None, "missed"),
        ({"earliest": "2026-05-01"}, DeliveryFacts(first_day="2026-04-30", last_day="2026-05-02"), None, "missed"),
        ({"latest": "2026-05-31"}, DeliveryFacts(first_day="2026-04-30", last_day="2026-05-02"), None, "met"),
        ({"earliest": "2026-05-01"}, DeliveryFacts(), None, "not testable"),
    ],
)
def test_a_client_has_limits_of_his_own(limits, facts, clause, outcome):
    found = outcomes(accepted(profile(kind="custom", **limits), facts, "it"))
    assert (found[clause] if clause else next(iter(found.values()))) == outcome
    assert profile(kind="custom", **limits).model_dump(exclude_defaults=True) == {"kind": "custom", **limits}


def test_a_project_names_what_was_agreed():
    told = {
        "project": "site",
        "crs": "EPSG:25832",
        "photographs": {"kind": "simulated"},
        "acceptance": {"kind": "asprs_2023", "plan": 1},
    }
    assert Project.model_validate(told).acceptance.points == 30


def test_products_of_another_program_are_inspected():
    grid = MapGrid(west=0, north=100, cell=1, rows=100, cols=100)
    rng = np.random.default_rng(0)
    points = tuple(
        SurveyedPoint(f"P{i}", (x, y, 10.0), (0.01, 0.01, 0.01), (x + 0.1, y))
        for i, (x, y) in enumerate(rng.uniform(20, 80, (9, 2)))
    )
    products = inspected(points, grid, lambda cells, window: np.full(window.shape, 10.2), IMAGE)
    found = products.statement
    assert len(products.points) == 9
    assert found.of("nva").fit == pytest.approx(0.2) and found.of("horizontal").fit == pytest.approx(0.1)
    assert found.of("nva").promised is None


def test_a_place_outside_of_the_orthoimage_was_not_measured_in_it():
    """Half of an orthoimage was tested at the points of the whole."""
    points = tuple(SurveyedPoint(f"P{x}", (x, 50.0, 10.0), (0.01, 0.01, 0.01), (x, 50.0)) for x in (30.0, 99.9, 100.1, -0.1))
    found = inspected(points, None, None, IMAGE).statement
    assert found.of("horizontal").points == 2 and {name for name, _ in found.untested} == {"P100.1", "P-0.1"}
    assert found.untested[0][1] == "place: its measured place lies outside of the orthoimage"


def test_points_of_another_program_under_vegetation_are_stated_apart():
    grid = MapGrid(west=0, north=100, cell=1, rows=100, cols=100)
    points = tuple(SurveyedPoint(name, (30.0 + i, 50.0, 10.0), (0.01, 0.01, 0.01)) for i, name in enumerate(("A", "V1", "V2")))
    given = points, grid, lambda cells, window: np.full(window.shape, 10.2), IMAGE
    found = inspected(*given, ("V*",)).statement
    assert (found.of("nva").points, found.of("vva").points) == (1, 2)
    with pytest.raises(WorkflowError, match=r"No check point is called W1 .*they are A, V1, V2"):
        inspected(*given, ("V*", "W1"))


def test_the_check_points_of_a_project_inspect_a_surface_of_somebody_else():
    grid = MapGrid(west=0, north=100, cell=1, rows=100, cols=100)
    control = Control(
        points=tuple(
            ControlPoint(name=f"P{i}", role=role, xyz=(20.0 + i, 50.0, 10.0), sigma=(0.01, 0.01, 0.01), measurements={})
            for i, role in enumerate(("check", "check", "control"))
        )
    )
    known = Inspector(None, None, control, None, ("check", "control"))
    image = (grid, lambda cells, window: np.full((*window.shape, 3), 9.0, np.float32))
    found = known.products((grid, lambda cells, window: np.full(window.shape, 10.2)), image).statement
    assert found.of("nva").points == 2 and found.of("nva").fit == pytest.approx(0.2)
    assert {reason for _, reason in found.untested} == {"place: marked in no photograph"}
    surface = (grid, lambda cells, window: np.full(window.shape, 10.2))
    wooded = Inspector(None, None, control, None, vegetated=("*1",)).products(surface, None).statement
    assert wooded.of("nva").points == wooded.of("vva").points == 1
    told = accepted(profile(kind="asprs_2023", height=1.0), DeliveryFacts(statement=wooded), "theirs")
    assert "Vegetated Vertical Accuracy (VVA)" in told.findings[0]
