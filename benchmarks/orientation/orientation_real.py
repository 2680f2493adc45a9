"""Orientation of real photographs: against what is known of them, and beside COLMAP in the same run.

The photographs are those of the shared data (ORTHOMILL_DATA names the folder; the reduced Brighton photographs come with the
project). COLMAP runs from an environment of its own, whose Python PYCOLMAP_PYTHON names:

    python3 -m venv /tmp/pycolmap && /tmp/pycolmap/bin/pip install pycolmap

Without it its columns stay empty. CPU seconds are those of all processes of a run, from reading the photographs to the adjusted
block; one small run before warms the compiled code, as COLMAP's is compiled already.
"""

import json
import os
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT, orthomill
from benchmarks.orientation.orientation_truth import (
    Agreement,
    agreement,
    angle_file_poses,
    block_poses,
    colmap_poses,
    figure,
    fountain_poses,
    mean_residual,
)
from benchmarks.orientation.stone_wall import Wall, compared, control_texts, read_wall
from orthomill.schemas.orientation import Block

DATA = Path(os.environ.get("ORTHOMILL_DATA", ROOT.parent / "shared" / "data"))
PEER = Path(os.environ.get("PYCOLMAP_PYTHON", "/tmp/pycolmap/bin/python"))
REDUCED = ROOT / "workflows" / "photographs" / "brighton"
K = (2759.48, 2764.16, 1520.69, 1006.81)
"""fx, fy, cx, cy of fountain_p11, COLMAP's corner convention"""
NGI_GSD = 5.9
"""m"""


class NotOriented(Exception):
    """A run failed; what it said."""


@dataclass(frozen=True)
class Row:
    """One block. `known`: what the truth says, in words; `peer`: COLMAP's result.json, if it ran."""

    name: str
    photos: str
    points: int
    residual_px: float
    cpu: float
    known: str
    peer: dict | None = None
    peer_known: str = ""


def _workflow(name: str, folder: Path, pattern: str, parts: dict[str, str], interior: str) -> str:
    """A workflow up to the orientation; `parts`: crs, cameras, positions, control."""
    lines = [f"{key}: {value}" for key, value in parts.items()]
    return "\n".join(
        [
            f"project: {name}",
            *lines,
            f"photographs: {{kind: folder, path: photographs, pattern: '{pattern}'}}",
            "stages:",
            "  - kind: photos",
            "  - kind: calibration",
            "  - kind: tie_points",
            "  - kind: orientation",
            f"    interior: {{kind: {interior}}}",
            "",
        ]
    )


def run_block(root: Path, name: str, folder: Path, pattern: str, parts: dict[str, str], interior: str) -> tuple[Path, float]:
    """Orient the photographs of a folder. Returns the run's folder and the CPU seconds."""
    (root / "workflows").mkdir(parents=True, exist_ok=True)
    if not (root / "photographs").exists():
        (root / "photographs").symlink_to(folder)
    (root / "workflows" / f"{name}.yaml").write_text(_workflow(name, folder, pattern, parts, interior))
    shutil.rmtree(root / "runs" / name, ignore_errors=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = orthomill(root, "run", name)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if run.code:
        said = [line for line in run.output.splitlines() if line.startswith("failed ")]
        raise NotOriented(said[-1] if said else run.output[-300:])
    return root / "runs" / name, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _peer(root: Path, folder: Path, model: str, camera: str, fixed: bool) -> dict | None:
    """COLMAP on the same photographs; None where it is not installed."""
    if not PEER.exists():
        return None
    names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() == ".jpg")
    job = {"photographs": str(folder), "names": names, "model": model, "camera": camera, "fixed": fixed}
    job["out"] = str(root / "colmap")
    (root / "colmap.json").write_text(json.dumps(job))
    subprocess.run([PEER, Path(__file__).with_name("colmap_block.py"), root / "colmap.json"], check=True, capture_output=True)
    return {**json.loads((root / "colmap" / "result.json").read_text()), "total": len(names)}


def row_of(name: str, run: Path, cpu: float, known: str, peer: dict | None = None, peer_known: str = "") -> Row:
    block = Block.model_validate_json((run / "tables/orientation/block.json").read_bytes())
    total = len(block.photos) + len(block.unoriented)
    points = int(figure(run, "orientation", "tie_points") or 0)
    return Row(name, f"{len(block.photos)} of {total}", points, mean_residual(run), cpu, known, peer, peer_known)


def _warm(root: Path) -> None:
    """Three photographs, so that no measured run compiles."""
    parts = {"crs": "EPSG:32615", "cameras": "{kind: exif}", "positions": "{kind: exif}", "control": "{kind: none}"}
    run_block(root, "warm", REDUCED, "DJI_003[0-2]*", parts, "weighted")


def brighton(root: Path, folder: Path, name: str) -> Row:
    """Drone photographs from EXIF alone."""
    parts = {"crs": "EPSG:32615", "cameras": "{kind: exif}", "positions": "{kind: exif}", "control": "{kind: none}"}
    run, cpu = run_block(root, name, folder, "*.JPG", parts, "weighted")
    plan, height = (figure(run, "orientation", f"gnss_rmse_{word}") for word in ("plan", "height"))
    known = f"GPS residuals {plan:.2f} m in plan, {height:.2f} m in height"
    return row_of(name, run, cpu, known, _peer(root, folder, "OPENCV", "", False))


def fountain(root: Path) -> Row:
    """K given. Its two camera constants differ by 0.17 %; this project's camera has one, their mean."""
    c, x0, y0 = (K[0] + K[1]) / 2, K[2] - 3072 / 2, 2048 / 2 - K[3]
    parts = {"crs": "EPSG:32632", "cameras": f"{{kind: given, c: {c}, x0: {x0:.2f}, y0: {y0:.2f}}}", "positions": "{kind: none}"}
    folder = DATA / "fountain_p11" / "images"
    run, cpu = run_block(root, "fountain", folder, "*.jpg", parts, "fixed")
    truth = fountain_poses(DATA / "fountain_p11" / "gt_dense_cameras")
    peer = _peer(root, folder, "PINHOLE", ",".join(map(str, K)), True)
    theirs = _words(agreement(colmap_poses(root / "colmap" / "images.txt"), truth), 1000.0, "mm") if peer else ""
    own = _words(agreement(block_poses(run / "tables/orientation/block.json"), truth), 1000.0, "mm")
    return row_of("fountain_p11", run, cpu, own, peer, theirs)


def ngi(root: Path) -> Row:
    """Four metric photographs with 20 % overlap between strips."""
    parts = {"crs": "EPSG:2048", "cameras": "{kind: given, c: 833.333}", "positions": "{kind: none}"}
    run, cpu = run_block(root, "ngi", DATA / "ngi", "*_RGB.tif", parts, "fixed")
    found = agreement(block_poses(run / "tables/orientation/block.json"), angle_file_poses(DATA / "ngi" / "camera_pos_ori.txt"))
    return row_of("ngi", run, cpu, _words(found, 1.0, f"m (GSD {NGI_GSD} m)"))


def stone_wall(root: Path) -> Row:
    """A wall with named points; the camera as MicMac calibrated it."""
    wall = read_wall(DATA / "stone_wall")
    (root / "control").mkdir(parents=True, exist_ok=True)
    for name, text in zip(("points", "measured"), control_texts(wall), strict=True):
        (root / "control" / f"{name}.csv").write_text(text)
    camera = ", ".join(f"{name}: {getattr(wall.camera, name):.6f}" for name in ("c", "x0", "y0", "k1", "k2", "k3"))
    parts = {
        "crs": "EPSG:32632",
        "cameras": f"{{kind: given, {camera}}}",
        "positions": "{kind: none}",
        "control": "{kind: files, points: control/points.csv, measurements: control/measured.csv}",
    }
    run, cpu = run_block(root, "stone_wall", DATA / "stone_wall", "*.JPG", parts, "fixed")
    return row_of("stone_wall", run, cpu, f"{_against_micmac(wall, run)}; {_from_named_points(wall)}")


def _against_micmac(wall: Wall, run: Path) -> str:
    """Projection centres in the system of the control points, without any fit, in our own standard errors."""
    block = Block.model_validate_json((run / "tables/orientation/block.json").read_bytes())
    difference = np.array([np.array(p.centre) - wall.poses[p.photo][1] for p in block.photos])
    sigma = np.array([np.sqrt(np.diag(np.array(p.covariance))[:3]) for p in block.photos])
    rms, share = np.sqrt((difference**2).sum(axis=1).mean()), np.abs(difference / sigma)
    return f"centres {1000 * rms:.1f} mm from MicMac's, at most {share.max():.1f} of our standard errors"


def _from_named_points(wall: Wall) -> str:
    """Resection and intersection from the named points alone, against MicMac's orientation."""
    centre, turn, point = (np.abs(part) for part in compared(wall).standardised)
    return (
        f"from the named points alone: resection within {centre.max():.1f} (centres) and {turn.max():.1f} (attitudes), "
        f"intersection within {point.max():.1f} standard errors of MicMac's"
    )


def _words(found: Agreement, factor: float, unit: str) -> str:
    return (
        f"centres {factor * found.centre_rms:.2f} {unit} RMS, largest {factor * found.centre_largest:.2f}; attitudes "
        f"{found.angle_mean:.3f} degrees on average, largest {found.angle_largest:.3f}"
    )


def page(rows: list[Row], failures: list[str]) -> str:
    """The page of results."""
    head = ["# Orientation of real photographs", ""]
    table = ["| block | photos | tie points | mean residual px | CPU s | what is known |", "| --- | --- | --- | --- | --- | --- |"]
    for r in rows:
        table.append(f"| {r.name} | {r.photos} | {r.points} | {r.residual_px:.3f} | {r.cpu:.0f} | {r.known} |")
        if r.peer:
            p = r.peer
            table.append(
                f"| {r.name}, COLMAP {p['version']} | {p['photos']} of {p['total']} | {p['points']} | {p['error_px']:.3f} "
                f"| {p['cpu_seconds']:.0f} | {r.peer_known} |"
            )
    missing = [line for failure in failures for line in ("", failure)]
    missing += [] if PEER.exists() else ["", "COLMAP was not installed in this run; the module of the study says how."]
    return "\n".join([*head, *table, *missing, ""])


def main(words: list[str]) -> None:
    """The blocks named on the command line, or all; the page is written after each, so that a long run may be stopped."""
    found = DATA.exists()
    blocks: dict[str, Callable[[Path], Row]] = {"brighton_reduced": lambda root: brighton(root, REDUCED, "brighton_reduced")}
    if found:
        blocks |= {"brighton_full": lambda root: brighton(root, DATA / "brighton", "brighton_full")}
        blocks |= {"fountain_p11": fountain, "ngi": ngi, "stone_wall": stone_wall}
    else:
        print(f"The shared photographs are not at {DATA}; only the reduced Brighton block is measured.")
    rows: list[Row] = []
    failures: list[str] = []
    with tempfile.TemporaryDirectory(prefix="orthomill_orientation_") as folder:
        _warm(Path(folder) / "warm")
        for name in words or blocks:
            try:
                rows.append(blocks[name](Path(folder) / name))
            except NotOriented as error:
                failures.append(f"{name} was not oriented: {error}")
            write_page("orientation_real", words, page(rows, failures))
