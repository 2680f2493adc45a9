"""Tables 4.13 to 4.19 of the published check beside ours, on one page.

    python -m benchmarks published_pair_tables

Source: Skarlatos, 4.3 (sources/surface_check.md#results); the tables are made in `published_matching` and `published_orientation`.
"""

from benchmarks.checking.published_matching import SHAPES, difference_rows, filter_rows, matched
from benchmarks.checking.published_orientation import intersection_rows, points, real_rows, synthetic_rows
from benchmarks.instrument.result_page import write_page
from benchmarks.matching.dissertation_pair import CLEAN, NOISY


def main(words: list[str]) -> None:
    """Compute and keep the page."""
    noisy, _, _ = matched(NOISY, tuple(SHAPES))
    _, left, right = matched(CLEAN, ("square",))
    sets = points()
    lines = [
        "# The published check: matched points, surfaces and relative orientation",
        "",
        "Ours beside the printed values. The synthetic pair has no houses, trees and shadows, which is why fewer of its heights",
        "are wrong; errors of the commercial surfaces, of the film and of manual points are those of a stand-in (see the modules).",
        "",
        "## Table 4.13: matched points, and what both tests of 99 % reject",
        "",
        "| window | matched | kept | rejected (%) | printed: matched | rejected (%) |",
        "| --- " * 6 + "|",
        *filter_rows(noisy),
        "",
        "## Table 4.14: manual points minus surface",
        "",
        "The source computes the share beyond 0.75 m from mean and standard deviation by the normal law. Where a surface has",
        "blunders, that law tells more than is counted.",
        "",
        "| surface | points | beyond 0.75 m by the law (%) | counted (%) | mean | std | RMS | least | largest | "
        "printed: by the law (%) | mean | std | RMS | least | largest |",
        "| --- " * 15 + "|",
        *difference_rows(noisy),
        "",
        "## Table 4.15: relative orientation of the synthetic pair",
        "",
        "All angles are zero in truth. The source prints degrees and an error on the ground, which contradict each other: the last",
        "two columns are what each of them would be by the other (flying height 1900 m).",
        "",
        "| angle | true | ours (degrees) | standard error | on the ground (m) | printed (degrees) | printed on the ground (m) | "
        "ground by the degrees (m) | degrees by the ground |",
        "| --- " * 9 + "|",
        *synthetic_rows(left, right),
        "",
        "## Table 4.17: relative orientation of the real pair (stand-in), degrees",
        "",
        "| angle | matched | standard error | manual | standard error | printed: matched | manual | from exterior |",
        "| --- " * 8 + "|",
        *real_rows(sets),
        "",
        "Random errors of the printed size move an angle by its standard error, a thousandth of a degree at most; the printed",
        "columns differ by up to 0.06 degrees. So much needs errors of the images that are alike over large parts of them: in the",
        "stand-in, a deformation of the film of 14 micrometres.",
        "",
        "## Tables 4.18 and 4.19: sigma0 of intersections, mean and standard deviation, micrometres",
        "",
        "| points | orientation matched | std | printed | std | manual | std | printed | std | from exterior | std | printed | "
        "std |",
        "| --- " * 13 + "|",
        *intersection_rows(sets),
        "",
        "Manual points that leave 1.1 micrometres in table 4.17 cannot leave 9 in table 4.18 with the same orientation: the source",
        "must have used other image coordinates there.",
    ]
    write_page("published_pair_tables", words, "\n".join(lines))
