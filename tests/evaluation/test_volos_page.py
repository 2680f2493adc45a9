"""The page of results of the embedded projects: goals that are missed say so, and codes are listed with their standard errors."""

from benchmarks.volos import GOALS, goal_rows, honesty_rows, page


def figures(**values) -> dict:
    return {f"evaluation.{name}": {"value": value, "unit": "%"} for name, value in values.items()}


def test_a_goal_that_is_missed_says_so():
    runs = {"volos": figures(dsm_measured_share=95.0), "second": figures(dsm_measured_share=90.0)}
    (row,) = (row for row in goal_rows(runs) if "`evaluation.dsm_measured_share`" in row)
    assert "| 95.000 % | 90.000 % (missed) |" in row


def test_figures_that_a_run_does_not_have_are_left_blank():
    rows = list(goal_rows({"volos": {}}))
    assert len(rows) == len(GOALS) + 2 and all(row.count("| - |") >= 1 for row in rows[2:])


def test_codes_that_occur_are_listed_with_their_classes():
    known = figures(dsm_volume_roof_share=4.0, dsm_volume_roof_within_2_sigma=94.0, dsm_volume_roof_beyond_4_sigma=0.5)
    assert list(honesty_rows({"volos": known}))[2:] == ["| volume roof | 4.00; -; 94.00 / 0.50; - / - |"]
    assert "| volume roof |" in page({"volos": known}, [])
