"""Findings in tables: the code alone decides which finding a stored value is."""

import json
from typing import get_args

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError

from orthomill.schemas.findings import (
    camera_findings,
    contradiction_findings,
    control_findings,
    datum_findings,
    foreign_findings,
    observation_findings,
)
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.control_findings import ControlElsewhere, ControlFinding, HeightsNotTransformed
from orthomill.schemas.findings.datum_findings import NoDatum, TiltUnobserved
from orthomill.schemas.findings.foreign_findings import BlockUnexamined
from orthomill.schemas.findings.observation_findings import DistanceContradicted, MeasurementsRejected, Misfit
from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import BlockPrecision

MISFIT = {"photo": "a", "misfit_px": 41.5, "lies_on": "P2"}
VECTOR = (0.25, -0.5, 3.0)
BLOCK_VALUES = {
    "control_unmet": {"points": 3, "measured": 4, "turned": True},
    "marks_in_another_frame": {
        "counted": "so",
        "change": "do that",
        "factor": 0.64,
        "given_px": 140.0,
        "found_px": 0.6,
        "points": 5,
    },
    "no_datum": {"scaled": True, "scale_share": 0.1},
    "datum_given_up": {"worst": ("P1", "a")},
    "positions_crowded": {},
    "tilt_unobserved": {"tilt_sigma_deg": None, "basis": "attitude", "sigma_deg": 1.5},
    "control_on_a_line": {},
    "datum_misfit": {"ratio": 12.0},
    "block_bent": {
        "bend_m": -0.59,
        "extent_m": 61.0,
        "pixels": 27.3,
        "scatter_m": 0.007,
        "views_deg": None,
        "grave": True,
        "sure": True,
        "in_metres": True,
        "open_m": None,
        "without_control_m": 0.02,
    },
    "interior_demanded": {"camera": "n", "x0_px": -7.1, "y0_px": -14.4, "k3": -0.13, "sigma0_px": (0.138, 0.112)},
    "looks_upward": {},
    "axes_exchanged": {"exchanged_m": 0.04, "given_m": 512.0},
    "points_exchanged": {"first": "P1", "second": "P2", "exchanged_m": 0.04, "given_m": 12.4},
    "distortion_folds": {"camera": "n", "reach_px": 2100.0, "corner_px": 2500.0, "k1": -0.31, "c": 3500.0},
    "interior_undetermined": {"camera": "n", "share": None},
    "interior_fixed": {"cameras": ("n", "z")},
    "interior_unweighted": {"cameras": ("n",)},
    "constant_contradicted": {
        "camera": "n",
        "given_px": 3500.0,
        "adjusted_px": 3610.0,
        "sigma_px": 2.0,
        "fixed": False,
        "guessed": True,
    },
    "lens_contradicted": {"camera": "n", "given": (-0.1, 0.02), "fits": (-0.08, 0.01), "border_px": 3.4, "ratio": 12.0},
    "constant_nominal": {"camera": "n", "c": 3500.0, "share": 0.03, "guessed": False},
    "principal_point_moved": {"camera": "n", "moved_px": 90.0},
    "image_errors_correlated": {
        "rms_px": 0.4,
        "shown_px": 0.1,
        "camera_share": 0.8,
        "parameter": "c",
        "owner": "n",
        "sigma": 3.0,
        "white_sigma": 0.5,
    },
    "control_contradicted": {"point": "P1", "difference": VECTOR, "ratio": 30.0},
    "position_contradicted": {"photo": "a", "difference": VECTOR, "ratio": 9.0},
    "positions_elsewhere": {"photos": 12, "distance_m": 840.0},
    "positions_along_view": {"photos": 12, "along_m": -31.4},
    "positions_drift": {"photos": ("a", "b"), "hours": 0.4, "drift": (None, 0.1, 0.3), "sigma": (None, 0.01, 0.02)},
    "offset_adjusted": {
        "photos": ("a", "b"),
        "against": "others",
        "offset": (None, None, 15.1),
        "sigma": (None, None, 0.4),
        "tilt_deg": 10.0,
        "moved_m": 9.1,
        "heights": None,
        "zoom": 1.08,
        "stated": (3.0, 3.0, 5.0),
    },
    "constant_of_its_own": {"photos": ("a", "b"), "camera": "n", "c_px": 1725.0, "others_px": 1150.0, "used": False},
    "scale_contradicted": {"factor": 1.0004, "sigma": 0.00001, "map_factor": 0.9996},
    "unit_contradicted": {
        "unit": "feet",
        "heights_only": True,
        "given_m": 368.0,
        "fits_m": 0.2,
        "crs": "EPSG:26849",
        "heights_m": (532.7, 162.4),
    },
    "sources_disagree": {
        "source": "control",
        "parameter": "scale",
        "unit": "%",
        "value": 0.0,
        "sigma": 0.02,
        "others": 3.1,
        "others_sigma": 0.2,
    },
    "distance_contradicted": {
        "first": "P1",
        "second": "P2",
        "length": 12.5,
        "difference": -0.1,
        "measured": 12.6,
        "ratio": 11.0,
        "outcome": "undecided",
    },
    "distance_unchecked": {},
    "measurements_rejected": {"role": "control", "point": "P1", "measured": 5, "rejected": (MISFIT,)},
    "check_measurements_apart": {"point": "P1", "measured": 5, "apart": (MISFIT, MISFIT | {"lies_on": None})},
    "groups_unconnected": {"groups": (("a", "b", "c"), ("d", "e"))},
    "block_separate": {"photos": ("d", "e")},
    "largest_reconstruction": {"count": 3, "photos": 40},
    "photos_unknown": {"photos": ("z",)},
    "block_elsewhere": {"source": "block.json", "offset": VECTOR},
    "tie_points_misfit": {"source": "block.json", "rms_px": 4.5, "factor": 9.0},
    "block_unexamined": {"source": "block.json"},
}
CONTROL_VALUES = {
    "heights_not_transformed": {"crs": "EPSG:2100+5773"},
    "checks_unmarked": {"points": ("V1", "V2")},
    "photographs_absent": {"measurements": 3, "photos": ("a", "b"), "lost": ("P1",)},
    "targets_not_found": {"points": ("T1", "T2")},
    "targets_twice": {"codes": ("tag36h11-7",), "photos": ("a", "b")},
    "heights_all_zero": {"points": 5, "freed": True},
    "measurements_reduced": {"measurements": 25, "outside": 20, "factor": 5.0},
    "control_exchanged": {"points": 5, "crs": "EPSG:2180"},
    "control_in_degrees": {"points": 5},
    "heights_unknown": {
        "points": ("P1", "P2"),
        "zero": True,
        "left_out": ("P2",),
        "numbers": (-9999.0,),
        "alone": True,
        "lines": (2, 5),
        "path": "points.csv",
    },
    "heights_in_feet": {"crs": "EPSG:26849", "unit_m": 0.3048006096, "converted": True},
    "datum_apart": {"crs": "EPSG:32632", "fits": "EPSG:23032", "distance_m": 197.4},
    "coordinates_rounded": {"points": 5, "plan_m": 1.0, "height_m": None},
    "heights_of_two_systems": {"control": "EGM96 height", "positions": "the ellipsoid", "shift_m": None, "crs": "EPSG:32632+5773"},
    "measurements_of_originals": {"measurements": 9, "outside": 8, "original": (4032, 3024), "reduced": (1200, 900)},
    "control_elsewhere": {"points": 5, "crs": "EPSG:2100", "distance_m": 4.1e6, "fits": "EPSG:4326", "exchanged": True},
}
OF_BLOCK = datum_findings, camera_findings, observation_findings, contradiction_findings, foreign_findings
UNIONS = {"block": (BlockFinding, BLOCK_VALUES, OF_BLOCK), "control": (ControlFinding, CONTROL_VALUES, (control_findings,))}
CASES = [(union, code, values) for union, examples, _ in UNIONS.values() for code, values in examples.items()]


def members(union: object) -> tuple[type[BaseModel], ...]:
    return get_args(get_args(union)[0])


@pytest.mark.parametrize(("union", "code", "values"), CASES, ids=[code for _, code, _ in CASES])
def test_a_stored_code_gives_its_class_and_values_again(union, code, values):
    adapter = TypeAdapter(union)
    one = adapter.validate_python({"code": code} | values)
    assert one.code == code and one.model_dump(exclude={"code"}) == values
    again = adapter.validate_json(one.model_dump_json())
    assert type(again) is type(one) and again == one


@pytest.mark.parametrize("name", UNIONS)
def test_examples_name_every_code_of_the_file_format(name):
    """The keys above are the frozen codes: one that is renamed makes tables of existing projects unreadable."""
    union, examples, _ = UNIONS[name]
    codes = [model.model_fields["code"].default for model in members(union)]
    assert sorted(codes) == sorted(examples) and len(set(codes)) == len(codes)


@pytest.mark.parametrize("name", UNIONS)
def test_every_finding_of_a_module_belongs_to_its_union(name):
    union, _, modules = UNIONS[name]
    coded = {
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, BaseModel) and "code" in value.model_fields
    }
    assert coded == set(members(union))


@pytest.mark.parametrize("model", [model for union, _, _ in UNIONS.values() for model in members(union)], ids=lambda m: m.__name__)
def test_the_code_of_a_class_cannot_be_another(model):
    values = (BLOCK_VALUES | CONTROL_VALUES)[model.model_fields["code"].default]
    with pytest.raises(ValidationError, match="literal_error"):
        model(**values, code="something_else")


def test_findings_of_several_kinds_keep_their_order_in_a_table():
    adapter = TypeAdapter(BlockFinding)
    findings = tuple(adapter.validate_python({"code": code} | values) for code, values in BLOCK_VALUES.items())
    table = BlockPrecision(image_factor=1, position_factor=1, control_factor=1, rays=9, rejected=0, findings=findings)
    again = BlockPrecision.model_validate_json(table.model_dump_json())
    assert again == table and [finding.code for finding in again.findings] == list(BLOCK_VALUES)


def test_findings_of_control_are_stored_with_the_control():
    control = Control(
        findings=(ControlElsewhere(points=3, crs="EPSG:2100", distance_m=9e5), HeightsNotTransformed(crs="EPSG:2100"))
    )
    again = Control.model_validate_json(control.model_dump_json())
    assert again == control and [type(one) for one in again.findings] == [ControlElsewhere, HeightsNotTransformed]
    assert again.findings[0].fits is None and not again.findings[0].exchanged


@pytest.mark.parametrize(
    ("union", "stored", "sentence"),
    [
        (BlockFinding, {"code": "no_such_code"}, "does not match any of the expected tags"),
        (BlockFinding, {"scaled": True}, "Unable to extract tag using discriminator 'code'"),
        (BlockFinding, {"code": "heights_not_transformed", "crs": "EPSG:2100"}, "does not match any of the expected tags"),
        (ControlFinding, {"code": "no_datum", "scaled": True}, "does not match any of the expected tags"),
        (BlockFinding, {"code": "no_datum"}, r"no_datum\.scaled\s+Field required"),
        (BlockFinding, {"code": "datum_misfit", "ratio": "large"}, "valid number"),
        (BlockFinding, {"code": "block_elsewhere", "source": "b", "offset": [1, 2]}, "offset"),
        (BlockFinding, {"code": "tilt_unobserved", "tilt_sigma_deg": 1, "basis": "guess", "sigma_deg": 1}, "'attitude', 'down' or"),
    ],
)
def test_what_is_no_finding_is_refused(union, stored, sentence):
    with pytest.raises(ValidationError, match=sentence):
        TypeAdapter(union).validate_json(json.dumps(stored))


@pytest.mark.parametrize("outcome", ["excluded", "undecided", "downweighted", "check"])
def test_outcomes_of_a_contradicted_distance(outcome):
    values = BLOCK_VALUES["distance_contradicted"] | {"outcome": outcome}
    assert DistanceContradicted(**values).outcome == outcome
    with pytest.raises(ValidationError, match="'excluded', 'undecided', 'downweighted' or 'check'"):
        DistanceContradicted(**values | {"outcome": outcome.upper()})


def test_check_points_are_never_rejected():
    """They take no part in the adjustment and have a finding of their own."""
    with pytest.raises(ValidationError, match="'control' or 'tie'"):
        MeasurementsRejected(role="check", point="P1", measured=3, rejected=())


def test_equal_findings_are_equal_values():
    assert NoDatum(scaled=True) == NoDatum(scaled=True) != NoDatum(scaled=False)
    assert len({BlockUnexamined(source="a"), BlockUnexamined(source="a"), BlockUnexamined(source="b")}) == 2
    assert Misfit(photo="a", misfit_px=3).lies_on is None


def test_a_finding_cannot_be_changed_after_it_was_made():
    finding = TiltUnobserved(tilt_sigma_deg=2.0, basis="level", sigma_deg=1.0)
    with pytest.raises(ValidationError, match="frozen"):
        finding.sigma_deg = 0.1
