"""A public flight with an RTK drone, all defaults, as a user runs it: is its concrete floor flat, and do its tags fit the block?

    python -m benchmarks rtk_flight [FOLDER] [--surface]

FOLDER holds the photographs of the yard (default ../shared/data/rtk_yard). The flight is run as it is, and again without what its
tags say of precision and calibration. Floor: the 15th percentile of the heights (tie points; with --surface those of dsm.tif) in
cells of 5 m along the strips, within 15 m of their axis; a quadratic through the cells, those that trees or beams fill left out.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import orthomill
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK, BLOCK_PRECISION, GROUND_RESIDUALS
from orthomill.schemas.photo import PHOTOS
from orthomill.tasks.geometry.rotation import rotation_matrix

FACTORY = 1955.65
"""px: the constant that the factory measured, by the tags"""
CELL, WIDE, FLOOR, HALF = 5.0, 15.0, 25.0, 30.0
"""m: cells along the strips, half of the width and of the length of what is floor, and half of that over which its sag is stated"""
TAKEN = (b"RtkFlag", b"RtkStd", b"RtkSrc", b"DewarpData", b"CalibratedFocal", b"CalibratedOptical")
"""beginnings of the names of tags that the second run does without"""


@dataclass(frozen=True)
class Outcome:
    """What one run of the flight gives; lengths in m, angles in degrees."""

    sigma0_px: float
    sag: float
    centres: np.ndarray
    stated: np.ndarray
    c: float
    sigma_c: float
    attitude: np.ndarray
    said: tuple[str, ...]


def main(words: list[str]) -> None:
    """Both runs, and the page."""
    given = [word for word in words if not word.startswith("--")]
    photographs = Path(given[0] if given else "../shared/data/rtk_yard").resolve()
    surface = "--surface" in words
    with tempfile.TemporaryDirectory(prefix="orthomill_rtk_") as folder:
        rows = [
            _row(name, flown(Path(folder) / name.split()[0], photographs, without, surface))
            for name, without in (("as it is", ()), ("without RTK and calibration in its tags", TAKEN))
        ]
    write_page("rtk_flight", words, "\n".join((*_head("the surface" if surface else "the tie points"), *rows)))


def flown(root: Path, photographs: Path, without: tuple[bytes, ...], surface: bool) -> Outcome:
    """The outcome of `init` and `run` in the new folder `root`, from copies of the photographs `without` some tags."""
    (root / "photos").mkdir(parents=True)
    for file in sorted(photographs.glob("*.JPG")):
        content = file.read_bytes()
        for name in without:
            # Of the same length, so that no offset in the file changes.
            content = content.replace(name, b"X" + name[1:])
        (root / "photos" / file.name).write_bytes(content)
    for words in (("init", "yard", "--photos", "photos"), ("run", "yard", *(() if surface else ("--until", "orientation")))):
        done = orthomill(root, *words)
        if done.code:
            raise SystemExit(done.output)
    return outcome(root / "runs" / "yard", surface)


def outcome(run: Path, surface: bool) -> Outcome:
    """What a finished run says, beside its tags."""
    store = Store(run)
    block, precision, photos = store.table(BLOCK), store.table(BLOCK_PRECISION), store.table(PHOTOS)
    centres = np.array([photo.centre for photo in block.photos])
    positions = [point for point in store.table(GROUND_RESIDUALS).points if point.role == "position"]
    camera = next(iter(block.cameras.values()))
    own = {photo.name: photo for photo in photos.photos}
    stated = np.mean([own[point.name].position_sigma or (np.nan,) * 3 for point in positions], axis=0)
    return Outcome(
        block.sigma0_px,
        _sag(_heights(run, store, surface), centres),
        np.sqrt(np.mean([np.square(point.difference) for point in positions], axis=0)),
        stated,
        camera.c,
        float(np.sqrt(camera.covariance[0][0])) if camera.covariance else 0.0,
        _away_from_gimbal(block, own),
        tuple(finding.code for finding in precision.findings),
    )


def _heights(run: Path, store: Store, surface: bool) -> np.ndarray:
    """(n, 3) places and heights."""
    if not surface:
        points = store.table(GROUND_POINTS)
        return np.column_stack([points.x, points.y, points.z])
    with rasterio.open(run / "products" / "dsm.tif") as file:
        z, to_map = file.read(1), file.transform
    row, col = np.nonzero(np.isfinite(z))
    x, y = to_map @ (col + 0.5, row + 0.5)
    return np.column_stack([x, y, z[row, col]])


def _sag(heights: np.ndarray, centres: np.ndarray) -> float:
    """m by which the floor leaves its middle over HALF m to both sides."""
    middle = centres[:, :2].mean(axis=0)
    axis = np.linalg.svd(centres[:, :2] - middle, full_matrices=False)[2][0]
    along, across = ((heights[:, :2] - middle) @ np.column_stack([axis, (-axis[1], axis[0])])).T
    return _sag_of_cells(np.array(list(_cells(along[np.abs(across) < WIDE], heights[np.abs(across) < WIDE, 2]))))


def _cells(along: np.ndarray, z: np.ndarray) -> Iterator[tuple[float, float]]:
    for start in np.arange(-FLOOR, FLOOR, CELL):
        inside = (along >= start) & (along < start + CELL)
        if inside.sum() >= 20:
            yield start + CELL / 2, float(np.percentile(z[inside], 15))


def _sag_of_cells(cells: np.ndarray) -> float:
    """By the quadratic through the cells, the worst left out one by one while they stand out from the others."""
    while len(cells) > 6:
        rest = np.abs(cells[:, 1] - np.polyval(np.polyfit(cells[:, 0], cells[:, 1], 2), cells[:, 0]))
        if rest.max() < 4.0 * max(float(np.median(rest)), 0.01):
            break
        cells = np.delete(cells, rest.argmax(), axis=0)
    return float(np.polyfit(cells[:, 0], cells[:, 1], 2)[0] * HALF**2)


def _away_from_gimbal(block, own) -> np.ndarray:
    """(2,) root mean square of the tilts against the gimbal, less a common mounting of the camera."""
    turns = []
    for photo in block.photos:
        if own[photo.photo].attitude is not None:
            gimbal = rotation_matrix(*np.radians(own[photo.photo].attitude))
            turn = rotation_matrix(*np.radians(photo.omega_phi_kappa)) @ gimbal.T
            turns.append((turn[1, 2], turn[2, 0]))
    return np.degrees(np.std(turns, axis=0)) if turns else np.full(2, np.nan)


def _head(source: str) -> Iterator[str]:
    yield "# A public flight with an RTK drone, all defaults"
    yield ""
    yield f"Floor by {source}."
    yield ""
    yield (
        "20 photographs of a DJI P4 Multispectral RTK over a yard with concrete floors (Zaar Ali, MIT). Wanted: floor bent by "
        f"less than 0.03 m over 60 m, c within three standard errors of the factory's {FACTORY} px, attitudes within 0.3 degrees "
        "of the gimbal (less how the camera is mounted), no false warning. At 24a1819 the floor was a dome of 1.2 m, c 1777.8 px."
    )
    yield ""
    yield (
        "| tags | sigma0, px | floor over 60 m, m | positions less block, E N H, m | stated by the tags, m | c, px | in its "
        "standard errors from the factory's | tilts less gimbal, degrees | findings |"
    )
    yield "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"


def _row(name: str, found: Outcome) -> str:
    centres, stated, tilts = (", ".join(f"{v:.3f}" for v in values) for values in (found.centres, found.stated, found.attitude))
    away = abs(found.c - FACTORY) / found.sigma_c
    return (
        f"| {name} | {found.sigma0_px:.3f} | {found.sag:+.3f} | {centres} | {stated} | {found.c:.1f} +- {found.sigma_c:.1f} | "
        f"{away:.1f} | {tilts} | {', '.join(found.said)} |"
    )
