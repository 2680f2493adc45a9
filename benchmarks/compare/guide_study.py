"""What an existing height model brings to every way to heights: `python -m benchmarks guide_model runs/brighton`.

The centre of a real shore, and a rendered mountain. The model has posts 30 m apart with 2 m of noise (on the shore both are reduced
to the size of the block). Every way runs without it and with it, on the same ground; CPU time is that of matching, without the
surface.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.compare.compared_ground import Scene, shore
from benchmarks.compare.mountain_scene import mountain
from benchmarks.compare.replayed_crop import Replay
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.surface import HEIGHT, MEASURED, PROVENANCE
from orthomill.tasks.densification.plan.volume_jobs import GUIDE_REACH
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.evaluation.classes import PlaceClass

_DEM = "model.tif"
_GUIDE = {"guide": {"kind": "file", "path": _DEM}}
_RIM = 40
WAYS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "object space (default)": ({"kind": "object_space"}, _GUIDE),
    "vertical line locus": ({"kind": "vertical_line_locus"}, {"start": "terrain", **_GUIDE}),
    "guided": ({"kind": "guided", "guide": {"kind": "levels"}}, _GUIDE),
    "pyramid": ({"kind": "pyramid"}, _GUIDE),
    "pyramid, two coarse levels": ({"kind": "pyramid", "pyramid": {"levels": 2}}, _GUIDE),
    "cascade": ({"kind": "cascade"}, _GUIDE),
    "region growing": ({"kind": "region_growing"}, _GUIDE),
}
"""name, settings without a model, and what is added with it"""
_AFTER = ("surface", "cells", "report", "grid", "line-counts")
"""jobs that are not matching"""


@dataclass(frozen=True, eq=False)
class Matched:
    """A way on a scene: CPU seconds of matching, cells measured, % of those wanted, of these beyond the gross departure, %, and the
    greatest departure, m."""

    seconds: float
    found: float
    gross: float
    most: float
    replay: Replay


def matched(scene: Scene, settings: dict[str, Any]) -> Matched:
    """A way on a scene that may have a model beside it."""
    replay = Replay(scene.crop, files={_DEM: scene.model})
    replay.run(DensificationStage.model_validate({"kind": "densification", "matching": settings}))
    inner = slice(_RIM, -_RIM), slice(_RIM, -_RIM)
    wanted = (scene.known.classes == PlaceClass.CLEAR_GROUND)[inner]
    measured = wanted & np.isin(replay.rasters[PROVENANCE][inner], MEASURED)
    error = (replay.rasters[HEIGHT] - scene.known.height)[inner][measured]
    error = error - np.median(error) if len(error) else error
    gross = 100 * float((np.abs(error) > scene.gross).mean()) if len(error) else float("nan")
    found = 100 * float(measured.sum()) / max(int(wanted.sum()), 1)
    return Matched(matching_seconds(replay), found, gross, float(np.abs(error).max(initial=0.0)), replay)


def matching_seconds(replay: Replay) -> float:
    """CPU time without the surface."""
    return sum(value for item, value in replay.seconds.items() if not item.startswith(_AFTER))


def ranges(scene: Scene, guided: Replay) -> tuple[float, float]:
    """Parallaxes that are searched without and with the model, px: median of the pairs, mean of the places of the scene."""
    away = float(guided.rasters[GUIDE_REACH].sum(axis=-1).mean())
    whole, near = [], []
    for pair in scene.crop.store.table(PAIRS).pairs:
        middle = (pair.parallax_low + pair.parallax_high) / 2
        whole.append(pair.parallax_high - pair.parallax_low)
        # dp = p^2 dz / (B c)
        near.append(away * middle**2 / (pair.base * pair.c))
    return float(np.median(whole)), float(np.median(near))


def coarse_share(plain: Replay) -> float:
    """Share of the matching time of the default that its coarse levels take, %: the most that a model can save it."""
    coarse = sum(value for item, value in plain.seconds.items() if item.startswith("volume ") and item != "volume 0")
    return 100 * coarse / matching_seconds(plain)


def section(scene: Scene) -> list[str]:
    """A scene: how wide the search is, and the table."""
    lines, default = [], None
    for name, (settings, added) in WAYS.items():
        plain, guided = (matched(scene, asked) for asked in (settings, {**settings, **added}))
        default = default or (plain.replay, guided.replay)
        times = f"{plain.seconds:.1f} / {guided.seconds:.1f} | {plain.seconds / guided.seconds:.1f}"
        found, gross = f"{plain.found:.1f} / {guided.found:.1f}", f"{plain.gross:.2f} / {guided.gross:.2f}"
        lines.append(f"| {name} | {times} | {found} | {gross} | {plain.most:.2f} / {guided.most:.2f} |")
        print(scene.name, lines[-1], flush=True)
    assert default is not None
    whole, near = ranges(scene, default[1])
    return [
        f"## {scene.name.capitalize()}",
        "",
        f"Range of the search: {whole:.0f} px of parallax without the model, {near:.0f} px with it on the mean, {whole / near:.1f} "
        f"times less. The coarse levels of the default take {coarse_share(default[0]):.0f} % of its matching time.",
        "",
        f"| without / with the model | matching, CPU-s | times faster | measured, % | beyond {scene.gross:g} m, % | greatest, m |",
        "| --- " * 6 + "|",
        *lines,
        "",
    ]


def main(words: list[str]) -> None:
    """Both scenes."""
    real = shore(*run_folders(words, "brighton"))
    lines = ["# An existing height model as guide", "", ""]
    lines += [(__doc__ or "").split("\n\n")[1].replace("\n", " "), "", *section(real)]
    with mountain() as scene:
        lines += section(scene)
    write_page("guide_model", words, "\n".join(lines))
