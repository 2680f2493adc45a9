"""Four million triangles and 23 photographs of 10 Mpx, as a user would run them: workers, time, and how both grow.

`python -m benchmarks large_mesh` makes photographs and mesh (a rough sheet with a painted pattern, from different
distances) for each size, runs the stage `projection` with two workers in a folder of its own, and writes
`benchmarks/results/large_mesh.md`: the largest block once, and how smaller ones with photographs and pixels of half the resolution
grow. Sizes may be given as VERTICES_ALONG_A_SIDE:PHOTOGRAPHS:REDUCTION. It may be stopped at any moment and begun again: it goes on
where it was; remove `.cache/large_mesh` to measure anew. What a published program takes for its own 11 photographs of 6 Mpx and 175
thousand triangles is 1.23 GB (its log; another data set).
"""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import yaml

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT, orthomill, project_root, summary
from benchmarks.texture.texture_acceptance import sheet
from orthomill.pipeline.records.records import Records
from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.view import View
from orthomill.tasks.projection.frames.projection_frames import looking_at
from orthomill.tasks.visibility.scanline import central_projection
from tests.support.solid.whole_mesh import nearest_triangles

SIZES = ((1415, 23, 1), (354, 6, 2), (354, 12, 2), (708, 6, 2), (708, 12, 2))
"""vertices along a side of the sheet (4.0, 0.25, 1.0 million triangles), photographs, and by how much these are reduced"""
PATTERN = 4096
"""px along a side of the pattern that is painted on 10 m of the sheet"""
PROJECT = "large"
SCRATCH = ROOT / ".cache" / "large_mesh"


def pattern() -> np.ndarray:
    """(rows, cols, 3) uint8: blobs of all sizes."""
    rng, out = np.random.default_rng(3), np.zeros((PATTERN, PATTERN, 3), np.float32)
    for side in (16, 64, 256, 1024, 4096):
        coarse = rng.normal(0, 26, (side, side, 3)).astype(np.float32)
        out += cv2.resize(coarse, (PATTERN, PATTERN), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + out, 5, 250).astype(np.uint8)


def camera_of(reduction: int) -> Camera:
    """10 Mpx, reduced along both sides."""
    return Camera(name="large", width=3872 // reduction, height=2592 // reduction, c=3000.0 / reduction)


def views(count: int, camera: Camera) -> list[View]:
    """Photographs on a spiral above the sheet, 5 to 9 m away, all looking inwards."""
    out = []
    for k in range(count):
        angle, radius = 2.4 * k, 4.5 * np.sqrt((k + 0.5) / count)
        centre = np.array([radius * np.cos(angle), radius * np.sin(angle), 5.0 + 4.0 * (k % 5) / 4])
        out.append(View(f"p{k:02d}", camera, looking_at(centre, np.array([0.4 * centre[0], 0.4 * centre[1], 0.0])), centre))
    return out


def photograph(view: View, vertices: np.ndarray, triangles: np.ndarray, painted: np.ndarray) -> np.ndarray:
    """(rows, cols, 3): the pattern at the places of the sheet that the pixels show, black beside it."""
    camera = view.camera
    height, width = camera.height, camera.width
    raster = nearest_triangles(central_projection(view, (0.0, 0.0, 0.0)), vertices, triangles, Window(0, 0, height, width))
    col, row = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    principal = 0.5 * (width - 1), 0.5 * (height - 1)
    with np.errstate(divide="ignore"):
        depth = np.where(raster.triangle >= 0, 1.0 / raster.nearness, np.float32(np.nan)).astype(np.float32)
    across, up = (col - principal[0]) / camera.c, (principal[1] - row) / camera.c
    x, y = (
        depth * (view.rotation[0, k] * across + view.rotation[1, k] * up - view.rotation[2, k]) + view.centre[k] for k in range(2)
    )
    scale = PATTERN / 10.0
    places = np.nan_to_num((x + 5.0) * scale, nan=-9.0).astype(np.float32), np.nan_to_num((5.0 - y) * scale, nan=-9.0)
    return cv2.remap(painted, places[0], places[1].astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


def write_ply(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """A binary PLY."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    faces = np.empty(len(triangles), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, triangles
    with path.open("wb") as file:
        file.write(head.encode())
        file.write(vertices.astype("<f4").tobytes())
        file.write(faces.tobytes())


def make_project(folder: Path, side: int, photos: int, reduction: int) -> int:
    """Photographs, orientation, mesh and workflow; returns the number of triangles."""
    camera = camera_of(reduction)
    root = project_root(folder)
    data = folder / "data"
    data.mkdir()
    vertices, triangles = sheet(side)
    vertices = vertices.astype(np.float32).astype(np.float64)
    write_ply(data / "mesh.ply", vertices, triangles)
    painted, cameras = pattern(), {}
    flip = np.diag([1.0, -1.0, -1.0])
    for view in views(photos, camera):
        picture = photograph(view, vertices, triangles, painted)
        cv2.imwrite(str(data / f"{view.name}.jpg"), picture[..., ::-1])
        rotation = flip @ view.rotation
        matrix = [[camera.c, 0.0, 0.5 * (camera.width - 1)], [0.0, camera.c, 0.5 * (camera.height - 1)], [0.0, 0.0, 1.0]]
        place = {"t": (-rotation @ view.centre).tolist(), "centre": view.centre.tolist()}
        cameras[f"{view.name}.jpg"] = {
            "K": matrix,
            "R_world_to_camera": rotation.tolist(),
            **place,
            "width": camera.width,
            "height": camera.height,
        }
    (data / "cameras.json").write_text(json.dumps(cameras))
    plane = {"kind": "plane", "name": "front", "plane": {"kind": "normal", "point": [0, 0, 0], "normal": [0, 0, 1]}}
    workflow = {
        "project": PROJECT,
        "crs": "EPSG:3857",
        "photographs": {"kind": "folder", "path": str(data), "pattern": "*.jpg"},
        "cameras": {"kind": "given", "c": camera.c},
        "positions": {"kind": "none"},
        "stages": [
            {"kind": "photos"},
            {"kind": "calibration"},
            {"kind": "orientation", "exterior": {"kind": "matrices", "path": str(data / "cameras.json")}},
            {
                "kind": "projection",
                "surface": {"kind": "mesh", "path": str(data / "mesh.ply")},
                "outputs": [{**plane, "pixel": 0.002 * reduction, "size": [9, 9]}],
            },
        ],
    }
    (root / "workflows" / f"{PROJECT}.yaml").write_text(yaml.safe_dump(workflow, sort_keys=False))
    return len(triangles)


def measured(side: int, photos: int, reduction: int) -> str:
    """A row of the table: that of an earlier run of this program, or what the rest of the run adds to it."""
    folder = SCRATCH / f"{side}-{photos}-{reduction}"
    row, made, largest = folder / "row.md", folder / "triangles.txt", folder / "largest.txt"
    if row.is_file():
        return row.read_text()
    if not made.is_file():
        shutil.rmtree(folder, ignore_errors=True)
        made.write_text(str(make_project(folder, side, photos, reduction)))
    run = orthomill(folder, "run", PROJECT, "--workers", "2")
    if run.code != 0:
        raise SystemExit(run.output)
    peak = max(run.peak_bytes, int(largest.read_text()) if largest.is_file() else 0)
    largest.write_text(str(peak))
    row.write_text(row_of(folder, int(made.read_text()), photos, reduction, peak))
    # A finished run takes some 20 GB.
    shutil.rmtree(folder / "runs")
    shutil.rmtree(folder / "data")
    return row.read_text()


def row_of(folder: Path, triangles: int, photos: int, reduction: int, peak: int) -> str:
    """A row of the table from a finished run; `peak`: bytes of its largest process."""
    found = {name: entry["value"] for name, entry in summary(folder, PROJECT).items()}
    names = ("run.projection.peak_memory", "run.peak_memory", "run.projection.cpu_seconds", "run.wall_seconds")
    worker, largest, cpu, seconds = (found[name] for name in names)
    proof = f"{found['projection.left_out_blended_psnr']:.1f} dB, {100 * found['projection.left_out_blended_gradient']:.0f} %"
    pixels = photos * camera_of(reduction).width * camera_of(reduction).height / 1e6
    return (
        f"| {triangles / 1e6:.2f} million triangles, {photos} photographs, {pixels:.0f} Mpx | {worker:.0f} "
        f"| {largest_job(folder / 'runs' / PROJECT)} | {largest:.0f} "
        f"| {peak / 2**20:.0f} | {seconds / 60:.1f} | {cpu:.0f} | {cpu / pixels:.2f} "
        f"| {found['projection.front_coloured']:.1f} | {proof} |"
    )


def largest_job(folder: Path) -> str:
    """The job of the stage during which its largest worker grew to its size."""
    records = [record for record in Records(folder).of_stage("projection") if record.peak_bytes]
    peak = max(record.peak_bytes for record in records)
    # A process never shrinks in its own record: the first of its jobs that ended with this peak raised it.
    reached = [record for record in records if record.peak_bytes > 0.99 * peak]
    return min(reached, key=lambda record: record.started + record.seconds).item


HEAD = (
    "| what | largest worker of the stage, MiB | raised by the job | of the run | largest process, MiB | minutes "
    "| CPU-s of the stage | per Mpx of the photographs | coloured % | left out: PSNR, gradient |",
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
)


def main(words: list[str]) -> None:
    """Measure all sizes and write the page, row by row: the first one takes long."""
    lines = [
        "# Large meshes with many photographs",
        "",
        "Photographs of 3872 x 2592 px and an orthoimage of "
        "4500 x 4500 px (half of that along both sides in the smaller blocks), leave one out, textured model, depth pictures; two "
        "workers, kernels compiled or loaded as they come. Minutes are those of the clock, beside whatever else the machine did.",
        "",
        *HEAD,
    ]
    sizes = [(int(side), int(photos), int(reduction)) for side, photos, reduction in (word.split(":") for word in words)]
    for size in sizes or SIZES:
        lines.append(measured(*size))
        write_page("large_mesh", words, "\n".join(lines))
