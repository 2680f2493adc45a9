"""Self-calibrating bundles of the three published applications: formal against true errors, and the pattern of their Table 3."""

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.orientation.published_blocks import PublishedBlock, adjusted, church, entrance, interior_sigmas, site, texture_shift

SEEDS = 60
PUBLISHED = {
    "1 church entrance": (church, "1.36 / 1.03 / 0.87"),
    "2 entrance, control from scans": (entrance, "2.30 / 2.11 / 3.74"),
    "3.1 curved wall": (lambda: site(1), "4.9 / 3.1 / 7.3"),
    "3.2 two parallel walls": (lambda: site(2), "6.3 / 3.2 / 4.3"),
    "3.3 low wall, one strip": (lambda: site(3), "17.4 / 10.3 / 13.3"),
    **{
        f"3.3 with {times:g} times its relief": (lambda times=times: site(3, times), "17.4 / 10.3 / 13.3")
        for times in (0.5, 1.5, 2)
    },
}


def main(words: list[str]) -> None:
    """Measure, print and write the table."""
    rows = "\n".join(_row(name, make(), published) for name, (make, published) in PUBLISHED.items())
    write_page(
        "published_bundles",
        words,
        f"# Self-calibrating bundles of the published applications\n\n{SEEDS} seeds each. Objects and stations are ours: the "
        "report prints neither. True over formal: root mean square of errors in formal standard errors, over c, x0, y0, k1, k2. "
        "Apart: how far photographs find the same place of the true surface from each other, what blurs a blend. Relief is all "
        "that tells c from the distance in a strip of parallel photographs, so that the last part is shown with several.\n\n"
        "| application | sigma c / x0 / y0, px | published | true over formal | sigma0 over true | apart, px |\n"
        f"| --- | --- | --- | --- | --- | --- |\n{rows}\n",
    )


def _row(name: str, block: PublishedBlock, published: str) -> str:
    found = [adjusted(block, seed) for seed in range(SEEDS)]
    sigma = np.array([interior_sigmas(result) for result, _ in found])
    errors = np.array([result.state.interior[0, :5] - truth.interior[0, :5] for result, truth in found]) / sigma
    sigma0 = np.mean([result.sigma0_px for result, _ in found]) / block.sigma_px
    apart = np.sqrt(np.mean([texture_shift(result, truth, block) ** 2 for result, truth in found]))
    formal = " / ".join(f"{value:.2f}" for value in sigma.mean(axis=0)[:3])
    return f"| {name} | {formal} | {published} | {np.sqrt((errors**2).mean()):.2f} | {sigma0:.3f} | {apart:.2f} |"
