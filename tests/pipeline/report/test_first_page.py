"""The first page: one verdict that follows from what the stages say, every question answered, the dearest warnings first."""

import pytest

from orthomill.pipeline.engine.run_facts import RunFacts, StageRun
from orthomill.pipeline.report.first_page import NOT_DETERMINED, first_page
from orthomill.pipeline.report.present_reports import in_own_lengths
from orthomill.schemas.stage_report import OF_A_CAMERA, WHERE_CHECKED, Answer, Product, StageReport, Topic, Verdict

STAGES = (("simulation", "Simulated"), ("orientation", "Orientation"), ("texture", "Orthoimage"))


def run(*kinds, finished="2026-11-21T11:00:00"):
    stages = tuple(StageRun(kind, jobs=1, done=1) for kind in kinds or ("simulation", "orientation", "texture"))
    return RunFacts("p", "EPSG:2100", "0.1.0", "2026-11-21T10:00:00", finished, stages=stages)


def says(level, sentence="s.", weighs=True):
    return Verdict(level=level, sentence=sentence, weighs=weighs)


def page(reports, facts=None, folder=None, tmp_path=None):
    """The page of stages of which those without a report, or without a verdict of theirs, are good and do not weigh."""
    judged = {kind: StageReport(verdict=says("good", weighs=False)) for kind, _ in STAGES} | reports
    quiet = {
        kind: report.model_copy(update={"verdict": report.verdict or says("good", weighs=False)}) for kind, report in judged.items()
    }
    return first_page(quiet, STAGES, facts or run(), folder or tmp_path)


def test_silence_is_not_a_verdict(tmp_path):
    good, silent = StageReport(verdict=says("good")), StageReport()
    judged = {"simulation": good, "orientation": good, "texture": good}
    assert first_page(judged, STAGES, run(), tmp_path).level == "good"
    for reports in (judged | {"texture": silent}, {"simulation": good, "orientation": good}):
        found = first_page(reports, STAGES, run(), tmp_path)
        assert found.level == "unjudged" and found.headline.endswith("nothing says how good these results are: Orthoimage.")
    fair = judged | {"texture": silent, "orientation": StageReport(verdict=says("fair"))}
    assert first_page(fair, STAGES, run(), tmp_path).level == "fair", "what is known to be limited stays so"


@pytest.mark.parametrize(
    ("reports", "level"),
    [
        ({"orientation": StageReport(verdict=says("good")), "texture": StageReport(verdict=says("good"))}, "good"),
        ({"orientation": StageReport(verdict=says("good")), "texture": StageReport(verdict=says("fair"))}, "fair"),
        ({"orientation": StageReport(verdict=says("poor")), "texture": StageReport(verdict=says("fair"))}, "poor"),
        ({"orientation": StageReport(verdict=says("good"), warnings=("d",), doubts=("d",))}, "poor"),
        ({"orientation": StageReport(verdict=says("fair", weighs=False)), "texture": StageReport(verdict=says("good"))}, "good"),
        ({"orientation": StageReport(verdict=says("fair", weighs=False))}, "fair"),
    ],
)
def test_the_run_is_as_good_as_the_worst_that_weighs(reports, level, tmp_path):
    assert page(reports, folder=tmp_path).level == level


def test_neither_a_partial_nor_an_unfinished_run_is_ever_called_good(tmp_path):
    good = {"orientation": StageReport(verdict=says("good"))}
    partial = page(good, run("simulation", "orientation"), tmp_path)
    assert partial.level == "partial" and partial.headline.endswith("not run: orthoimage.")
    assert page(good, run(finished=None), tmp_path).level == "open"


def test_what_costs_most_is_told_first_and_a_simulation_last(tmp_path):
    reports = {
        "simulation": StageReport(warnings=("simulated",), aside=True, verdict=says("good", weighs=False)),
        "orientation": StageReport(warnings=("note", "loss", "doubt"), doubts=("doubt",), losses=("loss", "doubt")),
        "texture": StageReport(warnings=("holes",), losses=("holes",)),
    }
    found = page(reports, folder=tmp_path).cautions
    assert [(caution.cost, caution.sentence) for caution in found] == [
        ("doubt", "doubt"),
        ("loss", "loss"),
        ("loss", "holes"),
        ("note", "note"),
        ("note", "simulated"),
    ]


def test_every_question_is_answered_and_a_later_stage_knows_better(tmp_path):
    earlier = StageReport(
        answers=(Answer(topic=Topic.GROUND_PIXEL, text="0.6 m"), Answer(topic=Topic.REFERENCE, text="heights: x"))
    )
    reports = {"orientation": earlier, "texture": StageReport(answers=(Answer(topic=Topic.GROUND_PIXEL, text="0.5 m"),))}
    answers = dict(page(reports, folder=tmp_path).answers)
    assert list(answers) == [str(topic) for topic in Topic if topic not in (*OF_A_CAMERA, *WHERE_CHECKED)]
    assert answers[Topic.GROUND_PIXEL] == "0.5 m" and answers[Topic.REFERENCE] == "EPSG:2100, heights: x"
    assert answers[Topic.AREA] == NOT_DETERMINED


def test_a_calibration_alone_is_not_asked_for_a_survey(tmp_path):
    camera = StageReport(verdict=says("good", weighs=False), answers=(Answer(topic=Topic.CAMERA, text="c 900 px"),))
    alone = first_page({"calibration": camera}, (("calibration", "Calibration"),), run("calibration"), tmp_path)
    assert [topic for topic, _ in alone.answers] == [Topic.CAMERA, Topic.TIME], "neither a pixel on the ground nor a system"
    assert not alone.surveyed and page({}, folder=tmp_path).surveyed, "what the head of the page names the system by"
    surveyed = StageReport(answers=(Answer(topic=Topic.AREA, text="2 ha"),))
    both = dict(page({"simulation": camera, "texture": surveyed}, folder=tmp_path).answers)
    assert both[Topic.CAMERA] == "c 900 px" and both[Topic.HEIGHTS] == NOT_DETERMINED


def test_products_are_those_that_exist_with_their_size(tmp_path):
    (tmp_path / "products" / "colmap").mkdir(parents=True)
    (tmp_path / "products" / "ortho.tif").write_bytes(b"12345")
    (tmp_path / "products" / "colmap" / "images.txt").write_bytes(b"123")
    paths = ("products/ortho.tif", "products/colmap", "products/absent.laz")
    report = StageReport(products=tuple(Product(path=path, purpose="p") for path in paths))
    found = page({"texture": report}, folder=tmp_path).products
    assert [(file.product.path, file.size, file.format) for file in found] == [
        ("products/ortho.tif", 5, "GeoTIFF"),
        ("products/colmap", 3, "folder"),
    ]


def test_a_product_in_sheets_has_the_size_of_all_of_them(tmp_path):
    (tmp_path / "products" / "ortho_sheets").mkdir(parents=True)
    (tmp_path / "products" / "ortho.vrt").write_bytes(b"12345")
    (tmp_path / "products" / "ortho_sheets" / "0-0.tif").write_bytes(b"123")
    report = StageReport(products=(Product(path="products/ortho.vrt", purpose="p"),))
    (found,) = page({"texture": report}, folder=tmp_path).products
    assert (found.size, found.format) == (8, "GeoTIFF in sheets")


@pytest.mark.parametrize(
    ("report", "begins"),
    [
        (StageReport(verdict=says("good")), "Good: nothing was found that puts results in doubt or costs accuracy or ground."),
        (StageReport(verdict=says("good"), warnings=("n",)), "Good: nothing was found that puts results in doubt or costs"),
        (StageReport(verdict=says("good"), warnings=("l",), losses=("l",)), "Good: 1 warning says below where accuracy or ground"),
        (StageReport(verdict=says("poor"), warnings=("l",), losses=("l",)), "In doubt: see the reasons."),
        (StageReport(verdict=says("good"), warnings=("d",), doubts=("d",)), "In doubt: 1 finding must be looked at"),
    ],
)
def test_nothing_reassuring_stands_above_what_costs_something(report, begins, tmp_path):
    assert page({"orientation": report}, folder=tmp_path).headline.startswith(begins)


def test_a_part_of_a_run_names_its_doubts(tmp_path):
    doubtful = {"orientation": StageReport(verdict=says("good"), warnings=("d",), doubts=("d",))}
    assert "1 finding must be looked at" in page(doubtful, run("simulation", "orientation"), tmp_path).headline


def test_lengths_without_a_scale_are_told_as_such(tmp_path):
    block = StageReport(lengths="no metres", answers=(Answer(topic=Topic.GROUND_PIXEL, text="0.6 m"),))
    later = StageReport(answers=(Answer(topic=Topic.AREA, text="2 ha"), Answer(topic=Topic.ORTHOIMAGE, text="shows all")))
    answers = dict(page(in_own_lengths({"orientation": block, "texture": later}), folder=tmp_path).answers)
    assert answers[Topic.GROUND_PIXEL] == "0.6 units" and answers[Topic.AREA] == "20\u202f000 square units"
    assert answers[Topic.ORTHOIMAGE] == "shows all" and answers[Topic.PRECISION] == NOT_DETERMINED
