"""A public flight with an RTK drone, all defaults, as a user runs it: is its concrete floor flat, and do its tags fit the block?

    python -m benchmarks rtk_flight [FOLDER] [--surface]

FOLDER holds the photographs of the yard (default ../shared/data/rtk_yard). The flight is run as it is, and again without what its
tags say of precision and calibration. Floor: the 15th percentile of the heights (tie points; with --surface those of dsm.tif) in
cells of bands along the strips. The yard slopes across and along for its water, and not every band is seen everywhere: each has a
height and a slope of its own, and all share one quadratic term. Whether the yard is flat nobody has measured; its positions are.
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
from orthomill.tasks.adjustment.testing.adjustment_result import ObservationKind
from orthomill.tasks.adjustment.testing.position_trend import height_trend
from orthomill.tasks.geometry.rotation import rotation_matrix

FACTORY = 1955.65
"""px: the constant that the factory measured, by the tags"""
CELL, BAND, WIDE, HALF = 4.0, 5.0, 20.0, 30.0
"""m: cells along the strips in bands beside each other, half of the width of what is floor, and half of its length"""
LEAST = 20
"""points that tell the height of the floor in a cell"""
TAKEN = (b"RtkFlag", b"RtkStd", b"RtkSrc", b"DewarpData", b"CalibratedFocal", b"CalibratedOptical")
"""beginnings of the names of tags that the second run does without"""


@dataclass(frozen=True)
class Outcome:
    """What one run of the flight gives; lengths in m, angles in degrees; `redundancy`: the share of an error of a position that its
    residual shows, as a mean."""

    sigma0_px: float
    sag: tuple[float, float]
    bend: tuple[float, float]
    centres: np.ndarray
    stated: np.ndarray
    redundancy: float
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
        _bend(positions, centres),
        np.sqrt(np.mean([np.square(point.difference) for point in positions], axis=0)),
        stated,
        _redundancy(precision),
        camera.c,
        float(np.sqrt(camera.covariance[0][0])) if camera.covariance else 0.0,
        _away_from_gimbal(block, own),
        tuple(finding.code for finding in precision.findings),
    )


def _redundancy(precision) -> float:
    """Redundancy of the positions by their number of coordinates."""
    own = [group for group in precision.groups if group.name == ObservationKind.POSITIONS]
    return sum(group.redundancy for group in own) / max(sum(group.count for group in own), 1)


def _bend(positions, centres: np.ndarray) -> tuple[float, float]:
    """m by which the projection centres bend against their positions, and its standard error by the scatter."""
    trend = height_trend(centres[:, :2], np.array([point.difference[2] for point in positions]))
    return (trend.bend, float(trend.sigma[3]) * trend.radius**2) if trend else (np.nan, np.nan)


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


def _sag(heights: np.ndarray, centres: np.ndarray) -> tuple[float, float]:
    """m by which the floor leaves its middle over HALF m to both sides, and its standard error by the scatter of the cells: one
    quadratic for all bands, each with a height and a slope of its own."""
    middle = centres[:, :2].mean(axis=0)
    axis = np.linalg.svd(centres[:, :2] - middle, full_matrices=False)[2][0]
    along, across = ((heights[:, :2] - middle) @ np.column_stack([axis, (-axis[1], axis[0])])).T
    band, x, z = np.array(list(_cells(along, across, heights[:, 2]))).T
    each, x = np.eye(int(band.max()) + 1)[band.astype(int)], x / HALF
    return _robust_last(np.column_stack([each, each * x[:, None], x**2]), z)


def _cells(along: np.ndarray, across: np.ndarray, z: np.ndarray) -> Iterator[tuple[int, float, float]]:
    for number, side in enumerate(np.arange(-WIDE, WIDE, BAND)):
        for start in np.arange(-HALF, HALF, CELL):
            inside = (along >= start) & (along < start + CELL) & (across >= side) & (across < side + BAND)
            if inside.sum() >= LEAST:
                yield number, float(along[inside].mean()), float(np.percentile(z[inside], 15))


def _robust_last(design: np.ndarray, z: np.ndarray) -> tuple[float, float]:
    """The last coefficient and its standard error; cells that trees, walls and cars fill lose their weight."""
    weight = np.ones(len(z))
    for _ in range(30):
        root = np.sqrt(weight)[:, None]
        found = np.linalg.lstsq(design * root, z * root[:, 0], rcond=None)[0]
        rest = np.abs(z - design @ found)
        scatter = max(1.48 * float(np.median(rest)), 0.005)
        weight = np.minimum(1.0, 1.5 * scatter / np.maximum(rest, 1e-9)) * (rest < 4.0 * scatter)
    normal = (design * root).T @ (design * root)
    return float(found[-1]), scatter * float(np.sqrt(np.linalg.pinv(normal)[-1, -1]))


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
        "| tags | sigma0, px | floor over 60 m, m | bend of centres against positions, m | positions less block, E N H, m | "
        "stated by the tags, m | their ratio, E N H (by redundancy, were the tags right) | "
        "c, px | in its standard errors from the factory's | tilts less gimbal, degrees | findings |"
    )
    yield "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"


def _row(name: str, found: Outcome) -> str:
    centres, stated, tilts = (", ".join(f"{v:.3f}" for v in values) for values in (found.centres, found.stated, found.attitude))
    ratio = ", ".join(f"{v:.2f}" for v in found.centres / found.stated)
    away = abs(found.c - FACTORY) / found.sigma_c
    sag, bend = (f"{value:+.3f} +- {sigma:.3f}" for value, sigma in (found.sag, found.bend))
    return (
        f"| {name} | {found.sigma0_px:.3f} | {sag} | {bend} | {centres} | {stated} | "
        f"{ratio} ({np.sqrt(found.redundancy):.2f}) | {found.c:.1f} +- {found.sigma_c:.1f} | "
        f"{away:.1f} | {tilts} | {', '.join(found.said)} |"
    )
