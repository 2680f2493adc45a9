"""The experiments of the dissertation on least-squares matching, compared with the published figures.

    python -m benchmarks matching [--quick] [--texture PATH] [--every N] [--sections NAMES]
        [--cones DIR] [--motorcycle DIR]

`--quick` measures a small part in a minute. `--every N` tests every n-th of the ten bands of the experiment, and extracts the
middle of the overlap only. Sections: strategies, windows, readings, extraction, dense, speed, workers, real; each is kept in
.cache/matching when it is done, so that a long run can be made in pieces, and the page is assembled from all that exist.
Real pairs are measured where they are found.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.instrument.result_page import machine, revision, write_page
from benchmarks.matching.dissertation_pair import GroundTexture, ground_texture
from benchmarks.matching.matching_experiment import Experiment
from benchmarks.matching.matching_readings import readings_page
from benchmarks.matching.matching_speed import speed_table
from benchmarks.matching.matching_surfaces import (
    DENSE_WINDOW,
    PART_WINDOW,
    QUICK_WINDOW,
    cones,
    dense_page,
    extraction_page,
    motorcycle,
    real_page,
)
from benchmarks.matching.matching_windows import strategy_page, window_page
from benchmarks.matching.matching_workers import workers_page
from benchmarks.measured_run import ROOT

KEPT = ROOT / ".cache" / "matching"
TITLES = {
    "strategies": "Strategies: the best of now beside the published recipe",
    "windows": "Window experiments (tables 4.6 to 4.11), measured / published",
    "readings": "Readings of what the publication leaves open",
    "extraction": "Full extraction, nodes 30 px apart (table 4.12)",
    "dense": "Dense surface, nodes 4 px apart",
    "speed": "Speed",
    "workers": "Two workers against one",
    "real": "Real pairs with known parallaxes",
}


def arguments(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks matching")
    parser.add_argument("--quick", action="store_true", help="a small part only")
    parser.add_argument("--texture", type=Path, help="orthophoto with 0.169 m pixels; the shipped one by default")
    parser.add_argument("--every", type=int, default=1, help="every n-th of ten bands of the experiment")
    parser.add_argument("--sections", nargs="+", choices=list(TITLES), default=list(TITLES))
    parser.add_argument("--cones", type=Path, default=ROOT.parent / "shared" / "data" / "cones", help="folder of Middlebury Cones")
    parser.add_argument("--motorcycle", type=Path, default=Path("motorcycle"), help="folder skimage/data of scikit-image")
    return parser.parse_args(words)


def sections(options: argparse.Namespace) -> dict[str, Callable[[], list[str]]]:
    """Functions that measure a section and return it as Markdown."""
    texture = ground_texture(options.texture)
    experiment = Experiment.quick(texture) if options.quick else Experiment.full(texture, options.every)
    size = f"{len(experiment.points)} points, texture {texture.name}."
    part = QUICK_WINDOW if options.quick else PART_WINDOW if options.every > 1 else None
    pairs = [pair for pair in (cones(options.cones), motorcycle(options.motorcycle)) if pair is not None]
    return {
        "strategies": lambda: [size, "", *strategy_page(experiment)],
        "windows": lambda: [size, "", *window_page(experiment)],
        "readings": lambda: readings_page(texture, Experiment.quick if options.quick else one_band),
        "extraction": lambda: [f"Texture {texture.name}.", "", *extraction_page(texture, part)],
        "dense": lambda: [f"Texture {texture.name}.", "", *dense_page(texture, QUICK_WINDOW if options.quick else DENSE_WINDOW)],
        "speed": lambda: [speed_table()],
        "workers": lambda: workers_page(texture, QUICK_WINDOW if options.quick else DENSE_WINDOW),
        "real": lambda: real_page(pairs),
    }


def one_band(texture: GroundTexture) -> Experiment:
    """A tenth of the experiment: readings are many, and a tenth tells them apart."""
    return Experiment.full(texture, 10)


def page(folder: Path, notes: str) -> str:
    """The sections of a folder as one page, the notes on them first."""
    lines = [
        "# Least-squares matching: the published experiments",
        "",
        "CPU times were taken beside other work; accuracy does not depend on it.",
        "",
        notes.rstrip(),
        "",
    ]
    for name, title in TITLES.items():
        if (folder / f"{name}.md").is_file():
            lines += [f"## {title}", "", (folder / f"{name}.md").read_text().rstrip(), ""]
    return "\n".join(lines)


def main(words: list[str]) -> None:
    """Measure the sections asked for, keep each, and put the page together."""
    options = arguments(words)
    folder = KEPT / ("quick" if options.quick else "full")
    folder.mkdir(parents=True, exist_ok=True)
    measure = sections(options)
    for name in options.sections:
        # A page is made in pieces: each tells for itself where and when it was measured.
        lines = [f"Measured at commit {revision()} on {machine()}, {time.strftime('%Y-%m-%d')}.", "", *measure[name]()]
        (folder / f"{name}.md").write_text("\n".join(lines) + "\n")
        print(f"{name} is measured", flush=True)
    notes = (Path(__file__).parent / "matching_notes.md").read_text()
    if options.quick:
        print(page(folder, notes))
    else:
        write_page("matching", words, page(folder, notes))
