"""What is known of the orientation of the test photographs, and the comparison with it; conventions as the sources state them."""

import json
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.start.similarity import VerticalityConstraint, fit_similarity

Pose = tuple[np.ndarray, np.ndarray]
"""rotation (3, 3) world to image, and projection centre (3,)"""
_Y_DOWN = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Agreement:
    """Root mean square and largest distance of the projection centres after a similarity fit, in units of the truth, and mean and
    largest angle between the attitudes after the best common turn, degrees."""

    photos: int
    centre_rms: float
    centre_largest: float
    angle_mean: float
    angle_largest: float


def block_poses(path: Path) -> dict[str, Pose]:
    """Of a block.json or cameras.json."""
    block = Block.model_validate_json(path.read_bytes())
    return {p.photo: (rotation_matrix(*np.radians(p.omega_phi_kappa)), np.array(p.centre)) for p in block.photos}


def colmap_poses(images: Path) -> dict[str, Pose]:
    """Of COLMAP's images.txt, in its own system."""
    found = {}
    for line in [line for line in images.read_text().splitlines() if not line.startswith("#")][::2]:
        words = line.split()
        if words:
            w, x, y, z = map(float, words[1:5])
            rotation = np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
                ]
            )
            found[Path(words[9]).stem] = (_Y_DOWN @ rotation, -rotation.T @ np.array(words[5:8], float))
    return found


def fountain_poses(folder: Path) -> dict[str, Pose]:
    """Strecha's .camera files: K, zeros, R camera to world, centre, size."""
    found = {}
    for path in sorted(folder.glob("*.camera")):
        values = np.array(path.read_text().split(), float)
        found[path.name.split(".")[0]] = (_Y_DOWN @ values[12:21].reshape(3, 3).T, values[21:24])
    return found


def angle_file_poses(path: Path) -> dict[str, Pose]:
    """Lines of photo X Y Z omega phi kappa."""
    rows = [line.split() for line in path.read_text().splitlines() if len(line.split()) == 7]
    return {row[0]: (rotation_matrix(*np.radians(np.array(row[4:], float))), np.array(row[1:4], float)) for row in rows}


def micmac_poses(folder: Path) -> dict[str, Pose]:
    """MicMac's Orientation-*.xml: R camera to world, columns right, down, forward; photographs as their files are."""
    found = {}
    for path in sorted(folder.glob("Orientation-*.xml")):
        outer = ET.parse(path).getroot().find(".//Externe")
        rows = [np.array(outer.findtext(f".//CodageMatr/L{i}").split(), float) for i in (1, 2, 3)]
        name = path.name.removeprefix("Orientation-").removesuffix(".xml").split(".")[0]
        found[name] = (_Y_DOWN @ np.array(rows).T, np.array(outer.findtext("Centre").split(), float))
    return found


def agreement(own: dict[str, Pose], truth: dict[str, Pose]) -> Agreement:
    """Both blocks compared on the photographs that they share."""
    names = sorted(set(own) & set(truth))
    a, b = (np.array([poses[name][1] for name in names]) for poses in (own, truth))
    middle = b.mean(axis=0)
    fit = fit_similarity(a, b - middle, np.full(len(a), 1e6), VerticalityConstraint(np.array([0.0, 0.0, 1.0]), 0.0))
    distance = np.linalg.norm(fit.apply(a) - (b - middle), axis=1)
    U, _, Vt = np.linalg.svd(sum(truth[name][0].T @ own[name][0] for name in names))
    common = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    turns = [own[name][0] @ common.T @ truth[name][0].T for name in names]
    angle = np.degrees([np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)) for turn in turns])
    rms = float(np.sqrt((distance**2).mean()))
    return Agreement(len(names), rms, float(distance.max()), float(angle.mean()), float(angle.max()))


def mean_residual(run: Path) -> float:
    """Mean length of the image residuals that took part, px: what COLMAP calls its reprojection error."""
    import pyarrow.parquet as parquet

    table = parquet.read_table(run / "tables/orientation/image_residuals.parquet").to_pydict()
    used = np.array(table["used"])
    return float(np.hypot(np.array(table["v_col"])[used], np.array(table["v_row"])[used]).mean())


def figure(run: Path, stage: str, name: str) -> float | None:
    """A figure of a stage's report."""
    report = json.loads((run / f"tables/{stage}/report.json").read_text())
    return next((one["value"] for one in report["figures"] if one["name"] == name), None)
