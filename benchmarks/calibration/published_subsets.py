"""The published calibrations of few photographs, of weak and of strong perspective, and the calibrated constants of all nine sets.

`python -m benchmarks published_subsets` writes benchmarks/results/published_subsets.md. Photographs of the same number, boards and
lens are simulated: weak ones tilted by 3 to 8 degrees and not turned, strong ones by 20 to 38 degrees and turned. The constants
are computed from the published coefficients alone.

Source: Kawka 2021, tables 4-2 to 4-7, 4-10 to 4-15, 4-19 to 4-22, 4-25 to 4-28, 4-32 to 4-35, 4-38, 4-39, 4-44, 4-45, and
4-17, 4-30, 4-41, 4-42, 4-47, 4-48 (sources/calibration.md#results).
"""

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from benchmarks.calibration.board_setups import FIVE_BOARDS, SIX_BOARDS, SIX_BOARDS_LONGER, TWELVE_BOARDS, BoardSetup
from benchmarks.calibration.published_calibrations import SINGLE, SINGLE_LONGER, adjusted, standard_errors
from benchmarks.instrument.result_page import write_page
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.diagnosis.distortion_curve import RADIUS_SHARE, balancing_change

Perspective = Literal["weak", "strong"]
_TILTS: dict[Perspective, tuple[float, float]] = {"weak": (3.0, 8.0), "strong": (20.0, 38.0)}
_SONY_2 = replace(FIVE_BOARDS, name="five_boards, Sony", camera=SIX_BOARDS.camera)


class Subset(NamedTuple):
    """A published subset: tables, set-up, photographs, perspective, sigma0 (px), and the standard errors of c, x0, y0 (px)."""

    tables: str
    setup: BoardSetup
    photos: int
    perspective: Perspective
    sigma0: float
    printed: tuple[float, float, float]


SUBSETS = (
    Subset("4-2, 4-3", TWELVE_BOARDS, 3, "weak", 0.494, (2.4, 2.7, 3.0)),
    Subset("4-6, 4-7", TWELVE_BOARDS, 3, "strong", 0.743, (4.1, 4.5, 3.1)),
    Subset("4-10, 4-11", FIVE_BOARDS, 5, "weak", 0.429, (49.0, 7.2, 2.5)),
    Subset("4-14, 4-15", FIVE_BOARDS, 5, "strong", 0.457, (1.0, 1.0, 1.5)),
    Subset("4-19, 4-20", SIX_BOARDS, 5, "weak", 0.333, (0.8, 1.5, 1.3)),
    Subset("4-21, 4-22", SIX_BOARDS, 5, "strong", 0.377, (1.2, 1.3, 1.7)),
    Subset("4-25, 4-26", _SONY_2, 5, "weak", 0.299, (6.1, 3.2, 4.2)),
    Subset("4-27, 4-28", _SONY_2, 5, "strong", 0.387, (2.4, 4.2, 4.1)),
    Subset("4-32, 4-33", SIX_BOARDS_LONGER, 5, "weak", 0.266, (1.1, 1.3, 1.6)),
    Subset("4-34, 4-35", SIX_BOARDS_LONGER, 5, "strong", 0.405, (1.5, 1.4, 1.6)),
    Subset("4-38", SINGLE, 5, "weak", 0.354, (0.8, 1.0, 1.9)),
    Subset("4-39", SINGLE, 5, "strong", 0.320, (1.0, 2.1, 1.8)),
    Subset("4-44", SINGLE_LONGER, 5, "weak", 0.271, (1.1, 1.3, 1.8)),
    Subset("4-45", SINGLE_LONGER, 5, "strong", 0.375, (1.2, 2.2, 1.8)),
)
PHANTOM, SONY, CANON = (5472, 3648), (4912, 3264), (5184, 3456)
CONSTANTS = (
    ("Phantom 4 Pro, 1 (4-17)", PHANTOM, 3619.4, -3.080e-10, 3.546e-17, 3617.5),
    ("Phantom 4 Pro, 2 (4-17)", PHANTOM, 3687.5, 6.237e-10, -3.482e-17, 3694.9),
    ("Sony, 2 (4-30)", SONY, 4218.6, -7.508e-9, 4.198e-16, 4130.8),
    ("Sony, 1, 14 photographs (4-30)", SONY, 4195.2, -8.272e-9, 4.298e-16, 4096.9),
    ("Sony, 1, 11 photographs (4-41)", SONY, 4194.5, -8.795e-9, 6.352e-16, 4095.3),
    ("Sony, single (4-42)", SONY, 4207.1, -8.044e-9, 4.055e-16, 4110.3),
    ("Canon, several, 16 (4-47)", CANON, 4938.2, -1.248e-9, 2.816e-16, 4941.6),
    ("Canon, several, 14 (4-47)", CANON, 4937.6, -9.354e-10, 1.981e-16, 4938.7),
    ("Canon, single (4-48)", CANON, 4948.5, -5.998e-10, 1.410e-16, 4950.7),
)
"""set, size of its photographs (px), c (px), k1 (px^-2), k2 (px^-4), and the published c + dc (px)"""


def subset_row(subset: Subset) -> str:
    """A line: published / simulated standard errors, first constant and iterations."""
    strong = subset.perspective == "strong"
    setup = replace(subset.setup, tilt=_TILTS[subset.perspective], turned=strong and subset.setup.turned)
    head = f"| {subset.tables} | {setup.name} | {subset.photos} | {subset.perspective} |"
    try:
        result = adjusted(setup, subset.photos, subset.sigma0)
    except GeometryError as error:
        return f"{head} {error} | | | |"
    pairs = zip(subset.printed, standard_errors(result)[:3], strict=True)
    return f"{head} {' | '.join(f'{there:.3g} / {here:.3g}' for there, here in pairs)} | {result.iterations} |"


def constant_row(name: str, size: tuple[int, int], c: float, k1: float, k2: float, printed: float) -> str:
    """A line: c, the published constant, and ours from the published coefficients."""
    ours = c + balancing_change(c, (k1 * c**2, k2 * c**4, 0.0), RADIUS_SHARE * 0.5 * float(np.hypot(*size)))
    return f"| {name} | {c:.1f} | {printed:.1f} | {ours:.2f} |"


def page() -> str:
    """The whole page."""
    return "\n".join(
        [
            "# Published calibrations of few photographs, and calibrated constants",
            "",
            "Published / simulated standard errors in px. The published photographs are others (tilts, turns and boards are not "
            "stated), so that the pattern compares: strong perspective determines c where weak one hardly does.",
            "",
            "| tables | set-up | photographs | perspective | sigma c | sigma x0 | sigma y0 | iterations |",
            "| --- | --- | --- | --- | --- | --- | --- | --- |",
            *map(subset_row, SUBSETS),
            "",
            "## Calibrated constants",
            "",
            "c + dc (px) of the curve with the least distortion, from the published coefficients.",
            "",
            "| set (table) | c | published | ours |",
            "| --- | --- | --- | --- |",
            *(constant_row(*row) for row in CONSTANTS),
            "",
            "The row of 11 photographs is not reproduced: its published constant belongs to other coefficients than those printed.",
            "",
        ]
    )


def main(words: list[str]) -> None:
    """Compute, print and keep the page."""
    write_page("published_subsets", words, page())
