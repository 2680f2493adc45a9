"""The published church and entrance once more: standard errors of k1 and k2, residuals at control, errors of tie points.

`python -m benchmarks published_points` writes benchmarks/results/published_points.md.
"""

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.orientation.published_blocks import PublishedBlock, adjusted, church, entrance, interior_sigmas

SEEDS = 12
PUBLISHED = {
    "1 church entrance": (church, "0.04 / 0.19", "0.3", "1.3"),
    "2 entrance, control from scans": (entrance, "0.07 / 0.26", "1.5", "1.5"),
}


def row(name: str, block: PublishedBlock, k: str, control: str, ties: str) -> str:
    """A line of the table: sigma of k1 (1e-8 px^-2) and k2 (1e-15 px^-4), mm at control and at tie points, ours / published."""
    sigmas, at_control, at_ties = [], [], []
    for seed in range(SEEDS):
        result, truth = adjusted(block, seed)
        c = float(truth.interior[0, 0])
        sigmas.append(interior_sigmas(result)[3:5] * [1e8 / c**2, 1e15 / c**4])
        at_control.append(result.state.point[: block.control] - result.network.point[: block.control])
        at_ties.append(result.state.point[block.control :] - truth.point[block.control :])
    k1, k2 = np.mean(sigmas, axis=0)
    mm = [1e3 * float(np.sqrt(np.mean(np.concatenate(part) ** 2))) for part in (at_control, at_ties)]
    return f"| {name} | {k1:.2f} / {k2:.2f} | {k} | {mm[0]:.2f} | {control} | {mm[1]:.2f} | {ties} |"


def main(words: list[str]) -> None:
    """Measure, print and keep the table."""
    lines = [row(name, make(), *printed) for name, (make, *printed) in PUBLISHED.items()]
    text = (
        "# Coefficients, control and tie points of the published applications\n\n"
        f"{SEEDS} seeds each; objects and stations are ours, as the report prints neither. k1 in 1e-8 px^-2, k2 in 1e-15 px^-4; "
        "root "
        "mean square in mm of a coordinate: residuals at control, errors of tie points against the truth (published: their "
        "standard "
        "error).\n\n"
        "| application | sigma k1 / k2 | published | control, mm | published | tie points, mm | published |\n"
        "| --- | --- | --- | --- | --- | --- | --- |\n" + "\n".join(lines) + "\n"
    )
    write_page("published_points", words, text)
