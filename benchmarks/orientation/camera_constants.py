"""Camera constants that real blocks find by themselves, and their standard errors, beside what is known of the cameras.

    python -m benchmarks camera_constants [FOLDER]     (without it, in a folder that is thrown away)

The blocks are those of the shared data (ORTHOMILL_DATA) and, where ORTHOMILL_HELDOUT names their folder, held-out ones. FOLDER
keeps the runs: tie points that are there are not measured again, only the orientation is. "White" standard errors are those that
the same adjustment would report if no measurements had errors in common.
"""

import json
import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.orientation.orientation_real import DATA, REDUCED, K, run_block
from benchmarks.orientation.stone_wall import control_texts, read_wall
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.camera import CAMERAS, Camera
from orthomill.schemas.observations import CONTROL, TIE_POINTS
from orthomill.schemas.orientation import RELATIVE
from orthomill.schemas.photo import PHOTOS
from orthomill.tasks.adjustment.model.interior_settings import FreeInterior, InteriorChoice, WeightedInterior
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices

HELDOUT = os.environ.get("ORTHOMILL_HELDOUT")


@dataclass(frozen=True)
class Block:
    """A block up to its tie points: photographs, pattern, parts of its workflow; the `reference` of c in px and whose it is;
    `choices` of what is adjusted, by name."""

    name: str
    folder: Path
    pattern: str
    parts: dict[str, str]
    reference: float
    whose: str
    choices: dict[str, InteriorChoice]
    prepare: Callable[[Path], None] = lambda root: None


@dataclass(frozen=True)
class Found:
    """c in px with both standard errors, and the size of the errors in common (px) with the share of the camera."""

    c: float
    white: float
    sigma: float
    common: float | None
    share: float | None


def _free(*names: str) -> InteriorChoice:
    return FreeInterior(kind="free", parameters=names)


WEIGHTED = WeightedInterior(kind="weighted")
FREE = _free("c", "x0", "y0", "k1", "k2")
NOTHING = {"positions": "{kind: none}", "control": "{kind: none}"}
FILES = "{kind: files, points: control/points.csv, measurements: control/measured.csv}"


def _wall_control(root: Path) -> None:
    (root / "control").mkdir(parents=True, exist_ok=True)
    for name, text in zip(("points", "measured"), control_texts(read_wall(DATA / "stone_wall")), strict=True):
        (root / "control" / f"{name}.csv").write_text(text)


def blocks() -> Iterator[Block]:
    """Those that are on this machine."""
    exif = {"cameras": "{kind: exif}", "positions": "{kind: exif}", "control": "{kind: none}"}
    yield Block(
        "brighton_reduced",
        REDUCED,
        "*.JPG",
        {"crs": "EPSG:32615", **exif},
        1170.2,
        "EXIF (nominal)",
        {"weighted": WEIGHTED, "free c k1 k2": _free("c", "k1", "k2")},
    )
    if DATA.exists():
        drone = json.loads((DATA / "uav_reference/opensfm/reconstruction.json").read_text())[0]["cameras"]
        yield Block(
            "uav_reference",
            DATA / "uav_reference/images",
            "*.tif",
            {"crs": "EPSG:32651", **exif},
            1368.0 * next(iter(drone.values()))["focal_x"],
            "OpenSfM",
            {"weighted": WEIGHTED},
        )
        given = {"crs": "EPSG:32632", "cameras": "{kind: given, c: 2850}", **NOTHING}
        yield Block(
            "fountain_p11",
            DATA / "fountain_p11/images",
            "*.jpg",
            given,
            0.5 * (K[0] + K[1]),
            "K, mean of its fx and fy",
            {"free": FREE, "free with p1 p2": _free("c", "x0", "y0", "k1", "k2", "p1", "p2")},
        )
        wall = {"crs": "EPSG:32632", "cameras": "{kind: exif}", "positions": "{kind: none}", "control": FILES}
        yield Block(
            "stone_wall",
            DATA / "stone_wall",
            "*.JPG",
            wall,
            read_wall(DATA / "stone_wall").camera.c,
            "MicMac",
            {"weighted": WEIGHTED, "free": FREE, "free c k1 k2": _free("c", "k1", "k2")},
            _wall_control,
        )
    if HELDOUT and (Path(HELDOUT) / "sceaux").exists():
        folder = Path(HELDOUT) / "sceaux"
        bare = {"crs": "EPSG:32631", "cameras": "{kind: exif}", **NOTHING}
        yield Block(
            "sceaux",
            folder,
            "*.JPG",
            bare,
            float((folder / "K.txt").read_text().split()[0]),
            "K.txt (from EXIF)",
            {"weighted": WEIGHTED, "free": FREE},
        )


def tie_points_of(block: Block, root: Path) -> Store:
    """The run of the block, measured where FOLDER has none."""
    run = root / "runs" / block.name
    if not (run / "tables/orientation/relative.json").exists():
        block.prepare(root)
        run, _ = run_block(root, block.name, block.folder, block.pattern, block.parts, "weighted")
    return Store(run)


def found(store: Store, choice: InteriorChoice, crs: str) -> Found:
    """The camera constant that the block finds with this choice."""
    photos, cameras, ties, control, relative = (store.table(t) for t in (PHOTOS, CAMERAS, TIE_POINTS, CONTROL, RELATIVE))
    choices = BlockChoices(interior=choice, gnss_shift="none", vertical_sigma=5.0, rejection=4.0)
    out = orient_block(photos, cameras, ties, control, relative, crs, choices)
    name, camera = next(iter(out.block.cameras.items()))
    precision = out.precision
    sigma = _sigma(camera)
    return Found(camera.c, precision.white_sigma.get(name, (sigma,))[0], sigma, precision.common_px, precision.common_share)


def _sigma(camera: Camera) -> float:
    return float(np.sqrt(camera.covariance[0][0])) if camera.covariance else 0.0


def row(block: Block, choice: str, one: Found) -> str:
    """One line of the table."""
    away = abs(one.c - block.reference)
    ratios = [f"{away / s:.1f}" if s > 0 else "" for s in (one.white, one.sigma)]
    common = "none" if one.common is None else f"{one.common:.2f} px, {100 * one.share:.0f} %"
    return (
        f"| {block.name} | {choice} | {one.c:.1f} | {block.reference:.1f} {block.whose} | {one.white:.2f} | {ratios[0]} | "
        f"{one.sigma:.2f} | {ratios[1]} | {common} |"
    )


HEAD = """# Camera constants of real blocks

c in px. Ratio: distance from the reference in standard errors. White: standard errors as if every measurement erred by itself.
Errors in common: root mean square over the frame, and the part of their variance that all photographs of the camera share. Where c
comes from EXIF and there is no control, the weighted choice keeps its value and states the doubt of EXIF (3 %, a lens of rounded
focal length more). References are of different worth: K of the fountain has fx 2759.5 and fy 2764.2 where c is one number here;
K.txt of sceaux is 2832 x 5.85 / 5.70, from EXIF and a width of the sensor, no calibration; so is that of brighton.

| block | adjusted | c found | reference | sigma, white | ratio | sigma | ratio | errors in common |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""


def main(words: list[str]) -> None:
    """All blocks that are here; the page is written after each."""
    with tempfile.TemporaryDirectory(prefix="orthomill_cameras_") as folder:
        root, rows = Path(words[0] if words else folder), []
        for block in blocks():
            store = tie_points_of(block, root / block.name)
            for name, choice in block.choices.items():
                rows.append(row(block, name, found(store, choice, block.parts["crs"])))
                write_page("camera_constants", words, HEAD + "\n".join(rows))
