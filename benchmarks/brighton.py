"""The drone block of a wooded shore: what of it has a height and by which code, how it compares with a peer's cloud, and whether
surfaces from disjoint strips agree within their standard errors.

`python -m benchmarks brighton` runs the shipped project in a folder of its own; `python -m benchmarks brighton runs/brighton` tells
of a finished run. There is no truth. The peer's cloud (OpenDroneMap's, of the same photographs in full resolution; ORTHOMILL_DATA
names the folder of the shared data) is compared after a plane, for either block is placed by the GPS of the drone alone. For the
strips the middle one and the two others are run anew with the orientation of the run: they share its datum and nothing else.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import laspy
import numpy as np
import yaml
from scipy import ndimage

import orthomill as library
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT, orthomill, project_root, run_folders, run_project
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import HEIGHT, PROVENANCE, RELATIVE_PRECISION, SURFACE, Provenance
from orthomill.tasks.geometry.view import block_view

PROJECT = "brighton"
CLOUD = Path(os.environ.get("ORTHOMILL_DATA", ROOT.parent / "shared" / "data")) / "brighton" / "model.laz"
MIDDLE = tuple(f"DJI_{number:04d}" for number in range(24, 30))
"""photographs of the middle one of three strips"""
EVERY = 2
"""every so many rows and columns of cells are judged: neighbours tell the same"""
CORNER = 576600.0, 5188100.0
"""m: from here the polygons count"""
PLACES = {
    "wood": (
        # the wood along the road
        (
            (32, 94),
            (53, 117),
            (82, 144),
            (112, 144),
            (138, 121),
            (137.5, 113),
            (131, 106.5),
            (121, 99.5),
            (114.5, 95),
            (104, 85),
            (97.5, 77),
            (88.5, 69.2),
            (82.2, 62),
            (70, 49.7),
            (62, 41.5),
            (56, 41),
            (32, 64),
        ),
        # the grove on the shore and the trees beside it
        (
            (125, 50),
            (128, 54),
            (133, 57.5),
            (138, 59),
            (148, 56.5),
            (158, 55),
            (157, 50),
            (156, 44),
            (150, 36.5),
            (146, 31),
            (140, 24),
            (133, 24.5),
            (126, 28),
            (118, 23.5),
            (112, 24),
            (111, 28),
            (113, 33),
            (116, 34),
            (122, 33),
            (127, 37),
            (126, 43),
        ),
        # the grove in the north-east
        (
            (137, 85),
            (138, 89.5),
            (143, 91.5),
            (148, 93),
            (148.5, 98.5),
            (155, 98.5),
            (156.5, 93),
            (159, 90.5),
            (161, 86),
            (166, 85),
            (174, 81),
            (170, 76),
            (163, 73),
            (156, 70.5),
            (147, 70.5),
            (140, 79),
        ),
        # single trees
        ((132, 61), (134, 66), (138, 67.5), (143, 67.5), (145, 63), (141, 60), (134, 59)),
        ((103, 70), (106, 72.5), (112, 67), (113, 64), (109, 63.5), (104, 67)),
        ((106.5, 47), (107.5, 51), (110.5, 50.5), (112.5, 46), (111.5, 43.5), (109, 44.5)),
        ((124.5, 93), (127, 98), (134.5, 96), (134, 91), (129, 91)),
        # shrubs
        ((158, 62), (159.5, 55), (164, 57), (168, 63), (173, 71), (176, 77), (171, 75), (163, 69)),
        (
            (94.5, 20),
            (96, 26),
            (99.5, 30.5),
            (104, 32.5),
            (110, 33.5),
            (113, 33),
            (112, 29.5),
            (105, 28.5),
            (103.5, 23),
            (98.5, 17.5),
        ),
        ((82.5, 12.5), (89, 14.8), (97, 17.5), (98, 15), (93, 13), (92, 5), (89, 5), (86, 9)),
    ),
    "water": (((96, -1), (102, 11), (110, 20), (120, 24), (132, 21), (138, 19), (132, 11), (123, -1)),),
}
"""polygons (m from CORNER) drawn on the orthoimage: trees and shrubs, and the lake; the rest is open ground, with cars"""
CLASSES = ("open", *PLACES)
RANKED = (
    Provenance.AGREED,
    Provenance.ONE_PAIR,
    Provenance.DISPUTED,
    Provenance.VOLUME,
    Provenance.COARSE,
    Provenance.WATER,
    Provenance.INCOHERENT,
    Provenance.INTERPOLATED,
)
"""codes from the best to the worst"""
_PAIRS = RANKED.index(Provenance.ONE_PAIR)
"""worst code of what pairs measured"""
_FEW = 1e-3
"""share of known cells below which nothing is smooth"""
_BEND = 10.0
"""m, some three hundred pixels: what differs over longer distances is the orientation of the strips, not matching"""
_NEAR = 0.5
"""m: farther apart, two surfaces show different things"""


@dataclass(frozen=True, eq=False)
class JudgedCells:
    """Every `EVERY`-th cell of a surface, each (rows, cols)."""

    grid: MapGrid
    """of these cells"""
    height: np.ndarray
    """m, NaN where there is none"""
    sigma: np.ndarray
    """m, of the height among its neighbours"""
    code: np.ndarray

    @property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """X and Y of the centres, m."""
        return np.meshgrid(*self.grid.centres(Window(0, 0, *self.grid.shape)))

    def rank(self) -> np.ndarray:
        """Place of every code in RANKED; its length where there is no height."""
        rank = np.full(self.code.shape, len(RANKED))
        for k, code in enumerate(RANKED):
            rank[self.code == code] = k
        return rank


def judged_cells(run: Path) -> JudgedCells:
    """The cells of a finished run. They lie on multiples of `EVERY` cells from the origin of the map."""
    project = library.open(run)
    grid = project.table(SURFACE).grid
    # Surfaces of one cell size lie on one grid; sampled from the same multiples, their cells can be subtracted.
    first = round(-grid.north / grid.cell) % EVERY, round(grid.west / grid.cell) % EVERY
    row, col = ((EVERY - start) % EVERY for start in first)
    bands = [project.raster(name).values[row::EVERY, col::EVERY] for name in (HEIGHT, RELATIVE_PRECISION, PROVENANCE)]
    # The centre of a sampled cell is that of its upper-left one.
    shift = 0.5 * (EVERY - 1) * grid.cell
    west, north = grid.west + col * grid.cell - shift, grid.north - row * grid.cell + shift
    rows, cols = bands[0].shape
    return JudgedCells(MapGrid(west=west, north=north, cell=EVERY * grid.cell, rows=rows, cols=cols), *bands)


def class_numbers(grid: MapGrid) -> np.ndarray:
    """(rows, cols) uint8: place of every cell's class in CLASSES."""
    classes = np.zeros(grid.shape, np.uint8)
    for number, name in enumerate(CLASSES[1:], 1):
        for polygon in PLACES[name]:
            x, y = np.array(polygon, float).T + np.array(CORNER)[:, None]
            cv2.fillPoly(classes, [np.rint(np.column_stack(grid.pixel(x, y))).astype(np.int32)], number)
    return classes


def seen_twice(cells: JudgedCells, block: Block) -> np.ndarray:
    """(rows, cols) bool: cells that lie in two photographs or more, at the mean height of the ground where they have none."""
    x, y = cells.places
    points = np.column_stack([x.ravel(), y.ravel(), np.where(np.isfinite(cells.height), cells.height, block.ground_mean).ravel()])
    views = [block_view(block, name) for name in block.names]
    return (np.sum([view.contains(view.project(points)) for view in views], axis=0) >= 2).reshape(x.shape)


def robust_surface(terms: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Coefficients (k,) of z (n,) = terms (n, k) @ coefficients, values beyond four NMAD left out."""
    kept = np.ones(len(z), bool)
    for _ in range(5):
        found = np.linalg.lstsq(terms[kept], z[kept], rcond=None)[0]
        left = z - terms @ found
        # From the median: gross errors on one side have drawn the first planes away from all others.
        kept = np.abs(left - np.median(left[kept])) < 4 * nmad(left[kept])
    return found


def surface_terms(x: np.ndarray, y: np.ndarray, bent: bool) -> np.ndarray:
    """The terms (n, 3 or 6) of a plane, or of a surface of second degree."""
    return np.stack([np.ones_like(x), x, y, *((x * x, x * y, y * y) if bent else ())], axis=-1)


def nmad(values: np.ndarray) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if values.size else float("nan")


def _percent(part: np.ndarray, digits: int = 1) -> str:
    return f"{100 * part.mean():.{digits}f}" if part.size else "-"


def _sentence(rank: int) -> str:
    return RANKED[rank].name.lower().replace("_", " ")


def completeness_rows(cells: JudgedCells, seen: np.ndarray, classes: np.ndarray) -> Iterator[str]:
    """Shares of what two photographs see, by class and code, and the standard errors of the codes."""
    yield "| class | share of the ground | any height | " + " | ".join(_sentence(k) for k in range(len(RANKED))) + " |"
    yield "| --- " * (len(RANKED) + 3) + "|"
    rank = cells.rank()
    for number, name in enumerate(("all", *CLASSES)):
        here = seen if number == 0 else seen & (classes == number - 1)
        shares = [_percent(rank[here] == k) for k in range(len(RANKED))]
        yield f"| {name} | {_percent(here[seen])} | {_percent(rank[here] < len(RANKED))} | " + " | ".join(shares) + " |"


def sigma_rows(cells: JudgedCells, seen: np.ndarray) -> Iterator[str]:
    """Quantiles of the standard errors among neighbours, by code."""
    yield "| code | 5 % of them below (m) | 25 % | half | 75 % | 95 % |"
    yield "| --- | --- | --- | --- | --- | --- |"
    rank = cells.rank()
    for k in range(len(RANKED)):
        sigma = cells.sigma[seen & (rank == k)]
        if sigma.size:
            yield (
                f"| {_sentence(k)} | " + " | ".join(f"{q:.3f}" for q in np.nanquantile(sigma, (0.05, 0.25, 0.5, 0.75, 0.95))) + " |"
            )


def cloud_rows(cells: JudgedCells, classes: np.ndarray, cloud: Path) -> Iterator[str]:
    """Heights minus the points of the peer's cloud, by class and code, a plane through open ground removed; and without what one
    block is bent against the other, which neither of them knows (the block's own word: `orientation.ground_bend_sigma`)."""
    points = laspy.read(cloud)
    x, y, z = (np.array(axis) for axis in (points.x, points.y, points.z))
    col, row = (np.rint(at).astype(int) for at in cells.grid.pixel(x, y))
    inside = (row >= 0) & (col >= 0) & (row < cells.grid.rows) & (col < cells.grid.cols)
    x, y, z, row, col = (values[inside] for values in (x, y, z, row, col))
    apart, rank, place = cells.height[row, col] - z, cells.rank()[row, col], classes[row, col]
    good = (place == 0) & (rank == 0)
    plane, bend = (surface_terms(x - x.mean(), y - y.mean(), bent) for bent in (False, True))
    level, local = (apart - terms @ robust_surface(terms[good], apart[good]) for terms in (plane, bend))
    yield "| class and code | points | NMAD (m) | wanted | within 0.5 m (%) | without the bend of one against the other: NMAD (m) |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for number, name in enumerate(CLASSES):
        for k in range(-1, len(RANKED)):
            here = (place == number) & ((rank < len(RANKED)) if k < 0 else (rank == k))
            chosen = level[here]
            if len(chosen) >= 1000:
                wanted = "0.07" if (number, k) == (0, -1) else ""
                words = "all codes" if k < 0 else _sentence(k)
                figures = f"{nmad(chosen):.3f} | {wanted} | {_percent(np.abs(chosen) < _NEAR)} | {nmad(local[here]):.3f}"
                yield f"| {name}, {words} | {len(chosen)} | {figures} |"


def common(one: JudgedCells, other: JudgedCells) -> tuple[JudgedCells, JudgedCells]:
    """The cells that two surfaces on one grid share."""
    cell = one.grid.cell
    row, col = round((one.grid.north - other.grid.north) / cell), round((other.grid.west - one.grid.west) / cell)
    rows, cols = (
        min(one.grid.rows - max(row, 0), other.grid.rows + min(row, 0)),
        min(one.grid.cols - max(col, 0), other.grid.cols + min(col, 0)),
    )
    return _part(one, max(row, 0), max(col, 0), rows, cols), _part(other, max(-row, 0), max(-col, 0), rows, cols)


def _part(cells: JudgedCells, row: int, col: int, rows: int, cols: int) -> JudgedCells:
    grid, part = cells.grid, (slice(row, row + rows), slice(col, col + cols))
    west, north = grid.west + col * grid.cell, grid.north - row * grid.cell
    cut = MapGrid(west=west, north=north, cell=grid.cell, rows=rows, cols=cols)
    return JudgedCells(cut, cells.height[part], cells.sigma[part], cells.code[part])


def agreement_rows(one: JudgedCells, other: JudgedCells) -> Iterator[str]:
    """Differences of two surfaces against their joint standard errors, by class and by the worse code of the two."""
    one, other = common(one, other)
    x, y = one.places
    x, y, classes = x - x.mean(), y - y.mean(), class_numbers(one.grid)
    apart, joint, rank = one.height - other.height, np.hypot(one.sigma, other.sigma), np.maximum(one.rank(), other.rank())
    good = (rank == 0) & (classes == 0)
    # What differs smoothly is the orientation of the strips, of which the standard errors among neighbours say nothing.
    plane = robust_surface(surface_terms(x[good], y[good], bent=False), apart[good])
    apart = apart - (plane[0] + plane[1] * x + plane[2] * y)
    bent = apart - smooth(apart, (rank <= _PAIRS) & (classes == 0) & (np.abs(apart) < _NEAR), round(_BEND / one.grid.cell))
    yield f"Open ground of the second is {-plane[0]:.3f} m higher in the middle; {int((rank < len(RANKED)).sum())} cells in common."
    yield ""
    yield (
        "| class and worse code | cells (%) | NMAD (m) | joint standard error, median (m) | within 2 | beyond 4 "
        f"| without what bends over {_BEND:.0f} m: NMAD (m) | within 2 (93 %) | beyond 4 (1 %) |"
    )
    yield "| --- " * 9 + "|"
    known = rank < len(RANKED)
    for number, name in enumerate(CLASSES):
        for k in range(len(RANKED)):
            here = (classes == number) & (rank == k)
            if here.sum() >= 1000:
                row = (
                    f"| {name}, {_sentence(k)} | {_percent(here[known])} | {nmad(apart[here]):.3f} | {np.median(joint[here]):.3f} "
                )
                row += _shares(apart[here] / joint[here])
                yield row + f"| {nmad(bent[here]):.3f} {_shares(bent[here] / joint[here])}|"


def _shares(ratio: np.ndarray) -> str:
    return f"| {_percent(np.abs(ratio) <= 2)} | {_percent(np.abs(ratio) > 4, 2)} "


def smooth(values: np.ndarray, known: np.ndarray, cells: int) -> np.ndarray:
    """The mean of the known values (rows, cols) in a square of `cells` cells; 0 where there are none."""
    share = ndimage.uniform_filter(known.astype(float), cells)
    total = ndimage.uniform_filter(np.where(known, values, 0.0), cells)
    return np.where(share > _FEW, total / np.maximum(share, _FEW), 0.0)


def strip_runs(run: Path, scratch: Path, cell: float) -> Iterator[Path]:
    """Run the middle strip, and the two others, with the orientation of a finished run; their folders."""
    for name in ("exterior_orientation.csv", "cameras.json"):
        shutil.copy(run / "products" / name, scratch)
    photographs = sorted((ROOT / "workflows" / "photographs" / PROJECT).glob("DJI_*"))
    for name, wanted in (("middle", True), ("outer", False)):
        (scratch / f"photographs_{name}").mkdir()
        for photo in photographs:
            if (photo.stem in MIDDLE) == wanted:
                (scratch / f"photographs_{name}" / photo.name).symlink_to(photo)
        _write_workflow(scratch, name, cell)
        done = orthomill(scratch, "run", name)
        if done.code != 0:
            raise SystemExit(done.output)
        yield scratch / "runs" / name


def _write_workflow(scratch: Path, name: str, cell: float) -> None:
    """The shipped workflow for a part of its photographs, up to the surface."""
    workflow = yaml.safe_load((ROOT / "workflows" / f"{PROJECT}.yaml").read_text())
    workflow |= {
        "project": name,
        "photographs": {"kind": "folder", "path": f"photographs_{name}"},
        "cameras": {"kind": "file", "path": "cameras.json"},
        "stages": [stage for stage in workflow["stages"] if stage["kind"] not in ("dsm_check", "texture")],
    }
    for stage in workflow["stages"]:
        if stage["kind"] == "orientation":
            stage["exterior"] = {"kind": "csv", "path": "exterior_orientation.csv"}
        if stage["kind"] == "densification":
            stage["cell"] = cell
    (scratch / "workflows").mkdir(exist_ok=True)
    (scratch / "workflows" / f"{name}.yaml").write_text(yaml.safe_dump(workflow, sort_keys=False))


def page(run: Path, strips: tuple[Path, ...]) -> str:
    """The page of results of a finished run and of the runs of its strips."""
    cells, block = judged_cells(run), library.open(run).block
    seen, classes = seen_twice(cells, block), class_numbers(cells.grid)
    lines = [f"# {PROJECT}: codes, a peer, and disjoint strips", ""]
    lines += ["## Ground that two photographs see, by code (%)", "", *completeness_rows(cells, seen, classes), ""]
    lines += ["## Standard errors among neighbours", "", *sigma_rows(cells, seen), ""]
    if CLOUD.is_file():
        lines += ["## Heights minus the peer's cloud", "", *cloud_rows(cells, classes, CLOUD), ""]
    lines += ["## The middle strip against the two others", "", *agreement_rows(*map(judged_cells, strips))]
    return "\n".join(lines) + "\n"


def main(words: list[str]) -> None:
    """Write the page: of the finished run in the first folder, or of a new one; further folders are the runs of its strips."""
    with tempfile.TemporaryDirectory() as scratch:
        if not words:
            root = project_root(Path(scratch) / "whole", PROJECT)
            run_project(root, PROJECT)
        run, *given = run_folders(words) if words else (root / "runs" / PROJECT,)
        cell = library.open(run).table(SURFACE).grid.cell
        strips = tuple(given) or tuple(strip_runs(run, Path(scratch), cell))
        write_page(PROJECT, words, page(run, strips))
