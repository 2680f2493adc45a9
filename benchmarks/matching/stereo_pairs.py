"""Real stereo pairs with truth: the stage's own matcher beside OpenCV's semi-global matching, on the same nodes in one run.

    python -m benchmarks stereo_pairs FOLDER ...

A FOLDER is one of the Middlebury stereo data in a third (2005, 2006: view1.png, view5.png, disp1.png; parallaxes in thirds of a px)
or a quarter of its size (2003: im2.png, im6.png, disp2; in quarters), named like the scene; or skimage/data of scikit-image
(Motorcycle).
"""

import sys
import time
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.matching.matching_peers import semi_global_opencv
from benchmarks.matching.matching_surfaces import StereoPair, motorcycle, nodes_of_both
from orthomill.tasks.matching.dense.pair_surface import ParallaxCode, match_pair

ROOM = 4.0
"""px beyond the parallaxes of the truth that are searched, on either side"""
GROSS = 3.0
"""px"""
_LAYOUTS = (("view1.png", "view5.png", ("disp1.png",), 3.0), ("im2.png", "im6.png", ("disp2.pgm", "disp2.png"), 4.0))


class Judged(NamedTuple):
    """A method on a pair: share of all nodes within 1 px, of the nodes that it calls measured that are beyond 1 and GROSS px, of
    their errors within 1, 2 and 3 standard errors, and nodes per CPU-second."""

    right: float
    measured: float
    beyond: float
    gross: float
    within: tuple[float, ...]
    speed: float


def pair_of(folder: Path) -> StereoPair:
    """The pair of a folder. Raises FileNotFoundError where it has none."""
    if found := motorcycle(folder):
        return found
    for first, second, truths, scale in _LAYOUTS:
        truth = next((folder / name for name in truths if (folder / name).is_file()), None)
        if truth is not None and (folder / first).is_file() and (folder / second).is_file():
            left, right, known = (cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE) for name in (first, second, truth.name))
            return StereoPair(folder.name, left, right, np.where(known > 0, known / scale, np.nan), 1.0 / scale)
    raise FileNotFoundError(f"{folder} holds no pair of the Middlebury stereo data with its truth.")


def judged(pair: StereoPair, parallax: np.ndarray, sigma: np.ndarray | None, measured: np.ndarray, seconds: float) -> Judged:
    """What parallaxes (rows, cols) of nodes 2 px apart are worth, with standard errors where there are any."""
    both = nodes_of_both(pair)
    error, of = np.abs(parallax - pair.truth[::2, ::2])[both], (measured & np.isfinite(parallax))[both]
    own = error[of]
    within: tuple[float, ...] = ()
    if sigma is not None and len(own):
        allowed = np.hypot(sigma[both][of], pair.quantum / np.sqrt(12.0))
        within = tuple(float((own <= k * allowed).mean()) for k in (1, 2, 3))
    beyond, gross = (float((own > limit).mean()) if len(own) else np.nan for limit in (1.0, GROSS))
    return Judged(float((error <= 1).mean()), float(of.mean()), beyond, gross, within, parallax.size / seconds)


def both_methods(pair: StereoPair) -> tuple[Judged, Judged]:
    """The stage's matcher and semi-global matching, each once after a call that may compile."""
    low, high = float(np.floor(np.nanmin(pair.truth))) - ROOM, float(np.ceil(np.nanmax(pair.truth))) + ROOM
    match_pair(pair.left, pair.right, low, high)
    started = time.process_time()
    surface = match_pair(pair.left, pair.right, low, high)
    took = time.process_time() - started
    own = judged(pair, surface.parallax, surface.sigma, surface.code == ParallaxCode.MEASURED, took)
    started = time.process_time()
    peer = semi_global_opencv(pair.left, pair.right, low, high)[::2, ::2]
    took = time.process_time() - started
    return own, judged(pair, peer, None, np.isfinite(peer), took)


def _line(name: str, own: Judged, peer: Judged) -> str:
    within = " / ".join(f"{100 * share:.0f}" for share in own.within)
    return (
        f"| {name} | {100 * own.right:.1f} | {100 * peer.right:.1f} | {100 * own.measured:.0f} | {100 * own.beyond:.1f} | "
        f"{100 * own.gross:.1f} | {within} | {own.speed / 1000:.0f} | {peer.speed / own.speed:.0f} |"
    )


def main(words: list[str]) -> None:
    """The page."""
    pairs = [pair_of(Path(word)) for word in words]
    found = {pair.name: both_methods(pair) for pair in pairs}
    better = sum(own.right > peer.right for own, peer in found.values())
    lines = [
        "# Real stereo pairs with truth",
        "",
        f"More right of all nodes than SGBM on {better} of {len(found)}. Nodes 2 px apart that both images show.",
        "",
        "| pair | within 1 px, of all % | SGBM, every value % | called measured % | of these beyond 1 px % | beyond 3 px % "
        "| of these within 1 / 2 / 3 standard errors % | thousand nodes per CPU-s | SGBM is faster, times |",
        "| --- " * 9 + "|",
        *(_line(name, *each) for name, each in found.items()),
        "",
        "Standard errors have that of the truth added, which is given in thirds or quarters of a pixel.",
    ]
    write_page("stereo_pairs", words, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
