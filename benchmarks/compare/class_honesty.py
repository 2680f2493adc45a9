"""Standard errors of windows that know no walls, by class: `python -m benchmarks class_honesty TOWN SECOND_TOWN SMALL_TOWN`.

The constants of these standard errors were set on the centre of the first town. The part west of it and the second town, which has
other streets, roofs, trees and cameras, took no part in that. Nor did the middle of the small town, of six photographs.
"""

from typing import Any

import numpy as np

from benchmarks.compare.compared_ground import Scene, town
from benchmarks.compare.replayed_crop import Replay
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.schemas.surface import HEIGHT, MEASURED, PROVENANCE, RELATIVE_PRECISION
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.evaluation.classes import PlaceClass

_RIM, _FEWEST = 40, 200
WAYS: dict[str, dict[str, Any]] = {
    "vertical line locus": {"kind": "vertical_line_locus"},
    "guided": {"kind": "guided"},
    "pyramid": {"kind": "pyramid"},
    "cascade": {"kind": "cascade"},
    "region growing": {"kind": "region_growing"},
    "vertical line locus, 25 px, 2 photographs, t test": {
        "kind": "vertical_line_locus",
        "window": 25,
        "photographs": 2,
        "threshold": {"kind": "t_test", "error_probability": 0.001},
    },
    "object space (the default)": {"kind": "object_space"},
}
PLACES = {
    "open": (PlaceClass.CLEAR_GROUND,),
    "beside buildings": (PlaceClass.BUILDING_MARGIN,),
    "beside trees": (PlaceClass.TREE_MARGIN,),
    "roofs": (PlaceClass.ROOF_INTERIOR, PlaceClass.ROOF_EDGE),
}
"""classes of ground by what they are called"""
_HEAD = (
    "NMAD of the heights of open ground and the median of their standard errors (m); then, by class, shares within 1 / within 2 / "
    "beyond 4 standard errors, %."
)


def shares(scene: Scene, settings: dict[str, Any]) -> list[str]:
    """NMAD and median standard error of open ground, m, and per class the shares within 1, 2 and beyond 4 standard errors, %: cells
    of a table."""
    replay = Replay(scene.crop).run(DensificationStage.model_validate({"kind": "densification", "matching": settings}))
    inner = slice(_RIM, -_RIM), slice(_RIM, -_RIM)
    heights, sigma, code = (replay.rasters[name][inner] for name in (HEIGHT, RELATIVE_PRECISION, PROVENANCE))
    known, classes = scene.known.height[inner], scene.known.classes[inner]
    measured = np.isin(code, MEASURED) & np.isfinite(known)
    away = heights - known
    # The datum of the block is common to all methods.
    level = measured & np.isin(classes, PLACES["open"])
    off = np.abs(away - np.median(away[level]))
    found = ((off / sigma)[measured & np.isin(classes, place)] for place in PLACES.values())
    shared = [
        f"{100 * (q < 1).mean():.0f} / {100 * (q < 2).mean():.0f} / {100 * (q > 4).mean():.1f}" if len(q) >= _FEWEST else "-"
        for q in found
    ]
    return [f"{1.4826 * np.median(off[level]):.3f}", f"{np.median(sigma[level]):.3f}", *shared]


def page(scenes: dict[str, Scene]) -> str:
    """The whole study."""
    lines = ["# Standard errors of windows by class of ground", ""]
    lines += [(__doc__ or "").split("\n\n")[1].replace("\n", " ").strip(), "", _HEAD, ""]
    lines += ["| part | method | NMAD | stated | " + " | ".join(PLACES) + " |", "| --- " * (4 + len(PLACES)) + "|"]
    for part, scene in scenes.items():
        for name, settings in WAYS.items():
            lines.append(f"| {part} | {name} | " + " | ".join(shares(scene, settings)) + " |")
            print(lines[-1], flush=True)
    return "\n".join([*lines, ""])


def main(words: list[str]) -> None:
    """Write the page from the finished runs of the three towns."""
    first, second, small = run_folders(words, "volos", "volos_second", "volos_small")
    parts = {
        "first town, centre (constants set here)": town(first),
        "first town, west of it": town(first, (0.4, 0.5)),
        "second town": town(second),
        "small town": town(small),
    }
    write_page("class_honesty", words, page(parts))
