"""The page says what happened: its verdict, its states, its key figures and its tables."""

import os
import re
from pathlib import Path

import pytest
from memory_store import MemoryStore

from orthomill.pipeline.engine.run_facts import Failure, RunFacts, StageRun
from orthomill.pipeline.report.accepted_part import accepted_part
from orthomill.pipeline.report.page import PictureView, Section, figure_row, label_of, leading, report_html
from orthomill.pipeline.report.page_template import length_text
from orthomill.pipeline.report.pictures import Drawing
from orthomill.schemas.accuracy.acceptance import AcceptanceResult, Clause
from orthomill.schemas.stage_report import Figure, Grid, Picture, StageReport, Verdict, report_table

STAGES = (("photos", "Photographs"), ("texture", "True orthoimage"))


def run(*stages: StageRun, **more) -> RunFacts:
    return RunFacts(
        "volos", "EPSG:2100", "0.1.0", "2026-11-21T10:00:00", **({"finished": "2026-11-21T11:00:00", "stages": stages} | more)
    )


def page(facts: RunFacts, **reports: StageReport) -> str:
    store = MemoryStore()
    for kind, report in ({"texture": StageReport(verdict=JUDGED)} | reports).items():
        store.put_table(report_table(kind), report)
    return report_html(store, STAGES, facts, Path())


def verdict(html: str) -> str:
    return re.search(r'<section class="verdict[^>]*>\s*<h2>(.*?)</h2>', html)[1]


def states(html: str) -> list[str]:
    return re.findall(r'<span class="state [^"]*">(.*?)</span>', html)


DONE = StageRun("photos", jobs=3, done=3)
JUDGED = Verdict(level="good", sentence="s.")
REPORT = StageReport(figures=(Figure(name="photos", value=12),))


@pytest.mark.parametrize(
    ("facts", "sentence"),
    [
        (run(DONE), "Part of a run: all 3 jobs of 1 stage are done; not run: true orthoimage."),
        (
            run(DONE, StageRun("texture", jobs=2, skipped=2)),
            "Complete: all 5 jobs of 2 stages are done, 2 of them unchanged since an earlier run; nothing says how good",
        ),
        (
            run(DONE, StageRun("texture", jobs=2, done=1)),
            "Not complete: 1 job is waiting. What is said below holds for what is done; run",
        ),
        (
            run(StageRun("photos", 9, 2, failed=2), StageRun("texture", 4), failures=(Failure("photos", "k", "s."),)),
            "Not complete: 2 jobs failed; 9 jobs are waiting; 1 stage has not begun.",
        ),
        (run(DONE, StageRun("texture"), finished=None), "Not complete: 1 stage has not begun."),
    ],
)
def test_the_verdict_counts_what_is_missing(facts, sentence):
    assert verdict(page(facts, photos=REPORT)).startswith(sentence)


def test_a_run_that_is_still_going_says_so():
    facts = run(DONE, StageRun("texture", jobs=1, done=1), finished=None)
    assert "it is still running or was interrupted" in verdict(page(facts, photos=REPORT, texture=REPORT))


@pytest.mark.parametrize(
    ("stage", "reported", "state"),
    [
        (StageRun("photos", 3, 3), True, "done"),
        (StageRun("photos", 3, 1, failed=1), True, "failed"),
        (StageRun("photos", 3, 1), True, "unfinished"),
        (StageRun("photos", 3, 1), False, "unfinished"),
        (StageRun("photos", 3), False, "not yet"),
    ],
)
def test_the_state_of_a_stage(stage, reported, state):
    assert states(page(run(stage), **({"photos": REPORT} if reported else {})))[0] == state


def test_the_report_of_an_earlier_run_is_not_shown():
    html = page(run(StageRun("photos", 3, 1, failed=1, reported=False)), photos=REPORT)
    assert "This stage has not reported yet." in html and ">Photos<" not in html


def test_warnings_are_at_the_top_and_with_their_stage():
    html = page(run(DONE), photos=StageReport(warnings=("Photograph DJI_0030 is blurred; take it again.",)))
    assert html.count("Photograph DJI_0030 is blurred; take it again.") == 2
    assert "Warnings</h2>" in html and "No stage has issued a warning." not in html
    assert "No stage has issued a warning." in page(run(DONE), photos=REPORT)


def test_many_failures_are_counted_above_and_listed_with_the_stage():
    failures = tuple(Failure("photos", f"photos/{n}/0/0", "It is truncated.") for n in range(12))
    html = page(run(StageRun("photos", 12, failed=12), failures=failures))
    assert "12 jobs failed.</b> photos/0/0/0: It is truncated. The others are listed with the stage." in html
    assert all(f"photos/{n}/0/0: It is truncated." in html for n in range(12))


def test_marked_figures_are_read_before_the_chapter_is_opened():
    signed = Figure(name="sigma0_px", label="Precision", value=0.31, unit="px", headline=True)
    html = page(run(DONE), photos=StageReport(figures=(Figure(name="photos", value=12), signed)))
    summary = html[html.index('<p class="signed">') : html.index("</summary>")]
    assert "Precision" in summary and "0.31" in summary and "Photos" not in summary


def test_a_stage_that_was_not_asked_for_is_named_and_never_called_done():
    html = page(run(DONE), photos=REPORT)
    assert states(html) == ["done", "not run"] and "This run was not asked for this stage." in html


def test_rows_of_a_grid_may_be_short():
    grid = Grid(title="Cameras", columns=("photo", "x", "y"), rows=(("a", 1.25), ("b", 2.5, 3)))
    html = page(run(DONE), photos=StageReport(grids=(grid,)))
    cells = re.findall(r'<td class="[^"]*">([^<]*)</td>', html[html.index("<h3>Cameras") :])[:6]
    assert cells == ["a", "1.25", "–", "b", "2.50", "3"]


def test_times_of_several_runs_are_distinguished():
    html = page(run(DONE, earlier=(60.0,), seconds=30.0, scheduler="2 processes on this machine"), photos=REPORT)
    assert (
        "2 runs produced these results in 1\u202fmin 30\u202fs; the last of them took 30\u202fs (2 processes on this machine)."
        in html
    )
    assert "The run as a whole took 30\u202fs." in page(run(DONE, seconds=30.0), photos=REPORT)


def test_the_workflow_and_the_machine_are_part_of_the_page():
    html = page(run(DONE, workflow="project: volos  # <name>\n", machine=(("cores", "2"),)), photos=REPORT)
    assert "project: volos  # &lt;name&gt;" in html and "<td>cores</td><td>2</td>" in html


@pytest.mark.parametrize(
    ("name", "unit", "label"),
    [
        ("sigma0_px", "px", "Sigma0"),
        ("pixel_um", "micrometres", "Pixel"),
        ("tilt_deg", "degrees", "Tilt"),
        ("dsm_rmse_m", "m", "DSM RMSE"),
        ("check_points", "", "Check points"),
        ("m", "m", "M"),
    ],
)
def test_a_label_is_made_from_the_name_without_its_unit(name, unit, label):
    row = figure_row("texture", Figure(name=name, value=1.0, unit=unit))
    assert (row.label, row.name, row.unit) == (label, f"texture.{name}", unit)


def test_labels_keep_abbreviations_in_capitals():
    assert label_of("gnss_rms_plan") == "GNSS RMS plan" and label_of("") == ""


@pytest.mark.parametrize(("metres", "text"), [(0.005, "5 mm"), (0.1, "0.1 m"), (50, "50 m"), (1000, "1 km"), (2500, "2.5 km")])
def test_lengths_on_the_ground(metres, text):
    assert length_text(metres).replace("\u202f", " ") == text


def pictured(kind: str, *titles: str, first_page: bool = True) -> Section:
    """A stage with pictures."""
    views = tuple(
        PictureView(title, Picture(title=title, raster="a/b", style="rgb", first_page=first_page), Drawing("", 1, 1))
        for title in titles
    )
    return Section(kind, kind, "done", StageRun(kind), StageReport(), (), views, (), (), (), ())


@pytest.mark.parametrize(
    ("sections", "first"),
    [
        ((pictured("densification", "surface"), pictured("texture", "orthoimage")), ["orthoimage", "surface"]),
        ((pictured("projection", "front", "section", "column"),), ["front", "section"]),
        ((pictured("photos", "a", "b", first_page=False), pictured("orientation", "map", first_page=False)), ["map", "a"]),
    ],
)
def test_results_of_the_last_stage_lead_in_its_own_order(sections, first):
    assert [view.name for view in leading(sections)] == first


def test_an_acceptance_is_shown_until_a_product_is_made_again(tmp_path):
    met, missed = (Clause(clause=name, found="0.03 m", limit="0.05 m", outcome=name) for name in ("met", "missed"))
    result = AcceptanceResult(profile="asprs_2023", delivery="volos", clauses=(met, missed), findings=("Tilted by 3 cm.",))
    facts, store = run(DONE, StageRun("texture", jobs=2, done=2)), MemoryStore()
    assert "<h2>Acceptance</h2>" not in report_html(store, STAGES, facts, tmp_path)
    (tmp_path / "acceptance.json").write_text(result.model_dump_json())
    shown = report_html(store, STAGES, facts, tmp_path)
    assert "1 of 2 clauses missed" in shown and "Tilted by 3 cm." in shown and '<td class="doubt">missed</td>' in shown
    product = tmp_path / "products" / "dsm.tif"
    product.parent.mkdir()
    product.touch()
    later = (tmp_path / "acceptance.json").stat().st_mtime + 10
    os.utime(product, (later, later))
    assert accepted_part(tmp_path) is None
    os.utime(tmp_path / "acceptance.json", (later + 5, later + 5))
    assert accepted_part(tmp_path) == result
    product.rename(in_sheets := product.with_suffix(".vrt"))
    os.utime(in_sheets, (later + 10, later + 10))
    assert accepted_part(tmp_path) is None
    in_sheets.unlink()
    (tmp_path / "acceptance.json").write_text("{")
    os.utime(tmp_path / "acceptance.json", (later + 5, later + 5))
    assert accepted_part(tmp_path) is None
