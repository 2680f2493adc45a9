"""What `orthomill relative` states of pairs, beside the truth: `python -m benchmarks relative_pairs RUN...`.

Of every pair of photographs of simulated scenes that the command takes, the five unknowns of the dependent form and those of five
rotations are compared with what the true block gives for them: from the tie points with the camera of the block, with the true
camera, and from the adjusted block. Shares of errors within 1, 2 and 3 of their own standard errors. A start that went wrong is one
that the command names and replaces. Diagonal pairs are among them, which share fewer points. The runs need their orientation only.
"""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.inspections.inspection import PairForms
from orthomill.schemas.observations import TIE_POINTS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.truth import TRUTH_BLOCK
from orthomill.tasks.orientation.relative.classical_forms import classical_forms


def told(run: Path) -> Iterator[tuple[PairForms, PairForms]]:
    """Of every pair what the command says, and the same of the true block, whose own figures are the truth."""
    store = Store(run)
    photos, points = store.table(PHOTOS), store.table(TIE_POINTS)
    block, true = store.table(BLOCK), store.table(TRUTH_BLOCK)
    for left, right in combinations(photos.names, 2):
        try:
            yield classical_forms(block, photos, points, left, right), classical_forms(true, photos, points, left, right)
        except GeometryError:
            continue


def ratios(pairs: list[tuple[PairForms, PairForms]], form: str) -> tuple[np.ndarray, ...]:
    """(N,) errors in their own standard errors: from the tie points, from these with the true camera, from the block."""
    both = [
        (own, true)
        for said, truth in pairs
        for own, true in zip(said.unknowns, truth.unknowns, strict=True)
        if own.form == form and own.sigma_of_points
    ]
    of_points = [abs(own.of_points - true.of_block) / own.sigma_of_points for own, true in both if own.sigma_of_points]
    true_camera = [abs(true.of_points - true.of_block) / true.sigma_of_points for _, true in both if true.sigma_of_points]
    of_block = [abs(own.of_block - true.of_block) / own.sigma_of_block for own, true in both if own.sigma_of_block]
    return tuple(map(np.array, (of_points, true_camera, of_block)))


def rows(run: Path) -> Iterator[str]:
    """The lines of a run."""
    pairs = list(told(run))
    wrong = sum(said.failed_start is not None for said, _ in pairs)
    for form in ("dependent", "five rotations"):
        cells = [
            " / ".join(f"{100 * (part <= k).mean():.0f}" for k in (1, 2, 3)) + f" | {part.max():.1f}"
            for part in ratios(pairs, form)
        ]
        yield f"| {run.name} | {len(pairs)} | {wrong} | {form} | {' | '.join(cells)} |"


def main(words: list[str]) -> None:
    """Write the page of the finished runs that are named."""
    lines = [
        "# Relative orientations of pairs, as they are stated",
        "",
        (__doc__ or "").split("\n\n", 1)[1].replace("\n", " ").strip(),
    ]
    head = ("run", "pairs", "starts that went wrong", "form")
    shares = (cell for name in ("tie points", "true camera", "block") for cell in (f"{name}: within 1 / 2 / 3, %", "largest"))
    lines += ["", f"| {' | '.join((*head, *shares))} |", "| --- " * 10 + "|"]
    for run in run_folders(words):
        lines += rows(run)
    write_page("relative_pairs", words, "\n".join([*lines, ""]))
