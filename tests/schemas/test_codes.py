"""Codes in rasters and tables: their numbers are part of the products and never change, and each has its words."""

import re

import numpy as np
import pytest

from orthomill.schemas import truth
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport, report_table
from orthomill.schemas.surface import PROVENANCE_CODES, Provenance
from orthomill.schemas.truth import MATERIAL_CLASSES, OPEN_MATERIALS, TRUTH_BLOCK, TRUTH_GRID, TRUTH_READERS, Material

NUMBERS = {
    Outcome: {
        "NOT_TRIED": 0,
        "CONVERGED": 1,
        "LOW_TEXTURE": 2,
        "OUTSIDE": 3,
        "NOT_CONVERGED": 4,
        "MOVED_TOO_FAR": 5,
        "SINGULAR": 6,
        "LOW_CORRELATION": 7,
        "INCONSISTENT": 8,
        "OCCLUDED": 9,
        "IMPRECISE": 10,
    },
    Provenance: {
        "EMPTY": 0,
        "ONE_PAIR": 1,
        "AGREED": 2,
        "DISPUTED": 3,
        "INTERPOLATED": 4,
        "VOLUME": 5,
        "INCOHERENT": 6,
        "COARSE": 7,
        "WATER": 8,
    },
    Material: {"OPEN_GROUND": 1, "FIELD": 2, "ROAD": 3, "ROOF": 4, "TREE": 5, "WATER": 6, "VEHICLE": 7, "WIRE": 8},
}


@pytest.mark.parametrize("codes", NUMBERS, ids=lambda codes: codes.__name__)
def test_stored_numbers_never_change(codes):
    known = {code.name: int(code) for code in codes}
    assert NUMBERS[codes].items() <= known.items(), "a new code gets a new number; an old one keeps its own"
    assert all(np.uint8(code) == code for code in codes)


@pytest.mark.parametrize("outcome", Outcome, ids=lambda outcome: outcome.name)
def test_every_outcome_has_words_of_its_own(outcome):
    assert outcome.sentence and not outcome.sentence.endswith(".")
    assert [other for other in Outcome if other.sentence == outcome.sentence] == [outcome]


@pytest.mark.parametrize(("codes", "legend"), [(Provenance, PROVENANCE_CODES), (Material, MATERIAL_CLASSES)])
def test_every_code_has_one_colour_and_one_meaning(codes, legend):
    assert [code for code, _, _ in legend] == list(codes)
    assert all(re.fullmatch("#[0-9a-f]{6}", colour) for _, colour, _ in legend)
    assert len({colour for _, colour, _ in legend}) == len({meaning for _, _, meaning in legend}) == len(codes)


def test_open_ground_is_bare():
    assert not {Material.ROOF, Material.TREE, Material.WATER} & set(OPEN_MATERIALS)


def test_the_truth_has_the_same_readers_everywhere():
    assert TRUTH_READERS == ("simulation", "evaluation")
    assert TRUTH_GRID.readers == TRUTH_BLOCK.readers == TRUTH_READERS
    names = [value for name, value in vars(truth).items() if name.startswith("TRUTH_") and isinstance(value, str)]
    assert len(names) == 9 and all(name.startswith("truth/") for name in names)


def test_the_bits_of_the_visibility_are_those_of_the_docstring():
    mask = np.uint32(0b1010)
    assert [int((mask >> i) & 1) for i in range(4)] == [0, 1, 0, 1]


# --- what a stage reports ----------------------------------------------------------------------------------------------------

NAN = float("nan")
REPORT = StageReport(
    figures=(
        Figure(name="sigma0", value=0.3, unit="px", headline=True),
        Figure(name="datum", value="GNSS"),
        Figure(name="a", value=None),
    ),
    grids=(Grid(title="Cameras", columns=("photo", "x"), rows=(("a", 1.5), ("b", None)), note="n"),),
    charts=(Chart(title="c", style="lines", x_label="x", y_label="y", x=(0.0, 1.0), series={"s": (1.0, 2.0)}, labels=("p", "q")),),
    pictures=(Picture(title="p", raster="a/z", style="classes", classes=((1, "#ffffff", "one"),)),),
    warnings=("One photograph did not join.",),
)


def test_a_report_survives_being_stored():
    assert StageReport.model_validate_json(REPORT.model_dump_json()) == REPORT
    assert report_table("texture").path == "texture/report.json" and report_table("texture").type is StageReport


def test_gaps_and_infinities_survive_being_stored():
    curve = REPORT.charts[0].model_copy(update={"series": {"s": (NAN, float("inf"))}})
    back = StageReport.model_validate_json(StageReport(charts=(curve,)).model_dump_json()).charts[0].series["s"]
    assert np.isnan(back[0]) and np.isinf(back[1])


def test_an_empty_report_says_nothing():
    empty = StageReport()
    assert not any((empty.figures, empty.grids, empty.charts, empty.pictures, empty.warnings))


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (Figure, {"name": "a", "value": 1, "colour": "red"}),
        (Picture, {"title": "a", "raster": "b", "style": "photo"}),
        (Chart, {"title": "a", "style": "pie", "x_label": "", "y_label": "", "x": (), "series": {}}),
        (Grid, {"title": "a", "columns": ("a",), "rows": (({},),)}),
    ],
)
def test_what_a_report_cannot_draw_is_refused_where_it_is_made(kind, wrong):
    with pytest.raises(ValueError, match="validation error"):
        kind(**wrong)


@pytest.mark.parametrize("value", [3, 0.25, "GNSS", True, None])
def test_a_figure_keeps_the_type_of_its_value(value):
    kept = Figure.model_validate_json(Figure(name="a", value=value).model_dump_json()).value
    assert kept == value and type(kept) is type(value)
