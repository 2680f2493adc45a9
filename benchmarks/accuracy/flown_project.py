"""A planned flight as a user has it: photographs in a folder, lists of positions and points, a camera, and a workflow.

The photographs are rendered by a project of their own, which keeps the truth; what is handed to the user's project is files, with
errors drawn here. The check points are where a surveyor would put them: on open ground, level, clear of objects, seen by three
photographs.
"""

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import yaml
from PIL import Image
from scipy.ndimage import minimum_filter, uniform_filter

from benchmarks.accuracy.flight_plans import POINTS, Plan
from benchmarks.measured_run import orthomill
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.schemas.truth import TRUTH_BLOCK, TRUTH_GRID, TRUTH_MATERIAL, TRUTH_SURFACE, TRUTH_VISIBILITY, Material
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.simulation.surveying import farthest_first

CLEAR, STEEPEST, SEEN = 2.0, 0.08, 3
"""m around a point that are open ground; rise over run; photographs that truly show it"""
STAGES = ("photos", "calibration", "tie_points", "orientation", "epipolar", "densification", "texture", "accuracy")
CALIBRATED = {"k1": 0.002, "k2": 0.004, "p1": 1e-4, "p2": 1e-4}
"""standard errors of a calibrated lens; those of its constant and principal point are shares of the constant"""
_SHARE_C, _SHARE_POINT = 1e-3, 5e-4
_FULL_FRAME_DIAGONAL = 43.27
_FOCAL_35MM = 0xA405


def fly(plan: Plan, root: Path) -> Path:
    """Render the photographs in the project root `root`; the folder of the run that holds them and the truth."""
    _workflow(root, f"{plan.name}_truth", {"photographs": {"kind": "simulated"}, "stages": [plan.simulation]})
    return _run(root, f"{plan.name}_truth")


def process(plan: Plan, root: Path, flown: Path) -> Path:
    """Write what a user has of the flight, run it until its accuracy is stated, and return the folder of the run."""
    truth, folder = Store(flown), root / plan.name
    block = truth.table(TRUTH_BLOCK)
    rng = np.random.default_rng([40, plan.number])
    (folder / "photos").mkdir(parents=True, exist_ok=True)
    for name in block.names:
        _photograph(flown / "photographs" / f"{name}.tif", folder / "photos" / f"{name}.jpg", block)
    _positions(plan, block, rng, folder)
    _points(plan, truth, block, rng, folder)
    camera = _camera(block, rng, folder) if plan.calibrated else {"kind": "exif"}
    points, measurements = f"{plan.name}/points.csv", f"{plan.name}/measurements.csv"
    _workflow(
        root,
        plan.name,
        {
            "photographs": {"kind": "folder", "path": f"{plan.name}/photos"},
            "cameras": {**camera, **({"path": f"{plan.name}/camera.json"} if plan.calibrated else {})},
            "positions": {"kind": "file", "path": f"{plan.name}/positions.csv"},
            "control": {"kind": "files", "points": points, "measurements": measurements},
            "stages": [{"kind": kind} for kind in STAGES],
        },
    )
    return _run(root, plan.name)


def _workflow(root: Path, name: str, parts: dict) -> None:
    (root / "workflows").mkdir(parents=True, exist_ok=True)
    text = yaml.safe_dump({"project": name, "crs": "EPSG:2100", "tile": 512, **parts}, sort_keys=False)
    (root / "workflows" / f"{name}.yaml").write_text(text)


def _run(root: Path, name: str) -> Path:
    shutil.rmtree(root / "runs" / name, ignore_errors=True)
    done = orthomill(root, "run", name, "--sequential")
    if done.code:
        raise RuntimeError(f"orthomill run {name} ended with {done.code}:\n{done.output}")
    return root / "runs" / name


def _photograph(source: Path, target: Path, block: Block) -> None:
    """A JPEG whose tags tell the focal length of a 35 mm film in whole millimetres, by the diagonal."""
    camera = next(iter(block.cameras.values()))
    tags = Image.Exif()
    focal = camera.c / np.hypot(camera.width, camera.height) * _FULL_FRAME_DIAGONAL
    tags[0x010F], tags[0x0110] = "orthomill", "simulated"
    tags.get_ifd(0x8769)[_FOCAL_35MM] = round(float(focal))
    with Image.open(source) as image:
        image.convert("RGB").save(target, quality=95, exif=tags)


def _positions(plan: Plan, block: Block, rng: np.random.Generator, folder: Path) -> None:
    """Projection centres with what a whole flight has in common, what drifts, and what each has by itself."""
    receiver, true = plan.positions, np.array([photo.centre for photo in block.photos])
    sigma = np.array(receiver.sigma)
    drift = np.linspace(-0.1, 0.1, len(true))[:, None] * receiver.common * rng.standard_normal(3)
    error = receiver.common * rng.standard_normal(3) + drift + receiver.single * rng.standard_normal(true.shape)
    rows = [(name, *place, *sigma) for name, place in zip(block.names, (true + sigma * error).round(3), strict=True)]
    _table(folder / "positions.csv", ("photo", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), rows)


def _points(plan: Plan, truth: Store, block: Block, rng: np.random.Generator, folder: Path) -> None:
    """Control around the block, check points anywhere, with errors of the survey, and marks in all photographs that show them."""
    places, masks = _open_places(truth, rng)
    control = farthest_first(places[:200, :2])[: plan.control]
    check = [k for k in range(len(places)) if k not in control][:POINTS]
    names = [*(f"C{k:02d}" for k in range(1, len(control) + 1)), *(f"P{k:03d}" for k in range(1, len(check) + 1))]
    points, marks = [], []
    for name, k in zip(names, [*control, *check], strict=True):
        sigma = plan.control_sigma if name.startswith("C") else plan.survey_sigma
        role = "control" if name.startswith("C") else "check"
        points.append((name, role, *(places[k] + rng.normal(0, sigma, 3)).round(4), *(3 * [sigma])))
        for number, photo in enumerate(block.names):
            if masks[k] >> number & 1:
                view = block_view(block, photo)
                pixel = view.project(places[k][None])[0] + rng.normal(0, plan.mark_sigma, 2)
                # Nobody marks beside the picture.
                if view.contains(pixel[None], margin=-0.5)[0]:
                    marks.append((name, photo, *pixel.round(3), plan.mark_sigma))
    _table(folder / "points.csv", ("name", "role", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), points)
    _table(folder / "measurements.csv", ("name", "photo", "col", "row", "sigma"), marks)


def _open_places(truth: Store, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Centres of cells (N, 3) m where a surveyor would put a point, in random order, and the masks of photographs that see them."""
    grid = truth.table(TRUTH_GRID)
    full = Window(0, 0, *grid.shape)
    height, material, seen = (truth.read(name, full) for name in (TRUTH_SURFACE, TRUTH_MATERIAL, TRUTH_VISIBILITY))
    open_ground = np.isin(material, (Material.OPEN_GROUND, Material.FIELD, Material.ROAD)).astype(np.uint8)
    free = minimum_filter(open_ground, 2 * int(CLEAR / grid.cell) + 1, mode="constant") > 0
    level = np.hypot(*np.gradient(uniform_filter(height, 5), grid.cell)) < STEEPEST
    # Beside an occlusion some of the nine cells are seen by fewer photographs.
    shown = minimum_filter(np.bitwise_count(seen), 3) >= SEEN
    row, col = np.nonzero(free & level & shown)
    order = rng.permutation(len(row))
    row, col = row[order], col[order]
    x, y = grid.centres(full)
    return np.column_stack([x[col], y[row], height[row, col]]).astype(np.float64), seen[row, col]


def _camera(block: Block, rng: np.random.Generator, folder: Path) -> dict[str, str]:
    """The camera of a calibration with errors of its own, and the covariance that it states."""
    true = next(iter(block.cameras.values()))
    sigma = {"c": _SHARE_C * true.c, "x0": _SHARE_POINT * true.c, "y0": _SHARE_POINT * true.c, **CALIBRATED}
    found = true.changed(**{name: true.value(name) + float(rng.normal(0, error)) for name, error in sigma.items()})
    covariance = np.diag([sigma.get(name, 0.0) ** 2 for name in INTERIOR])
    stated = Camera.model_validate({**found.model_dump(), "source": "file", "covariance": covariance.tolist()})
    (folder / "camera.json").write_text(stated.model_dump_json(indent=1))
    return {"kind": "file"}


def _table(path: Path, head: tuple[str, ...], rows: Iterable[tuple]) -> None:
    path.write_text("\n".join([",".join(head), *(",".join(map(str, row)) for row in rows)]) + "\n")
