"""COLMAP on a folder of photographs, run by the Python of its own environment: `python colmap_block.py JOB.json`.

The job names the photographs, the camera and the folder to write to; what comes out is COLMAP's text model and result.json with
the CPU seconds of features, matching and mapping, and the mean reprojection error. Imports nothing of this project.
"""

import json
import resource
import sys
import time
from pathlib import Path

import pycolmap


def cpu_seconds() -> float:
    """Of this process with all its threads, and of its children."""
    parts = (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    return sum(part.ru_utime + part.ru_stime for part in parts)


def main(job: dict) -> None:
    """Features, exhaustive matching, incremental mapping; `single`: one camera took all photographs; without it EXIF
    tells."""
    out = Path(job["out"])
    out.mkdir(parents=True, exist_ok=True)
    database = out / "database.db"
    database.unlink(missing_ok=True)
    reader = pycolmap.ImageReaderOptions(camera_model=job["model"], camera_params=job["camera"])
    clock, cpu, started = {}, cpu_seconds(), time.monotonic()
    pycolmap.extract_features(
        database,
        job["photographs"],
        image_names=job["names"],
        camera_mode=pycolmap.CameraMode.SINGLE if job.get("single", True) else pycolmap.CameraMode.AUTO,
        reader_options=reader,
        device=pycolmap.Device.cpu,
    )
    clock["features"] = cpu_seconds() - cpu
    pycolmap.match_exhaustive(database, device=pycolmap.Device.cpu)
    clock["matching"] = cpu_seconds() - cpu - clock["features"]
    options = pycolmap.IncrementalPipelineOptions()
    if job["fixed"]:
        options.ba_refine_focal_length = options.ba_refine_principal_point = options.ba_refine_extra_params = False
    models = pycolmap.incremental_mapping(database, job["photographs"], out, options)
    clock["mapping"] = cpu_seconds() - cpu - clock["features"] - clock["matching"]
    best = max(models.values(), key=lambda model: model.num_reg_images())
    best.write_text(out)
    result = {
        "version": pycolmap.__version__,
        "photos": best.num_reg_images(),
        "points": best.num_points3D(),
        "error_px": best.compute_mean_reprojection_error(),
        "cpu": clock,
        "cpu_seconds": sum(clock.values()),
        "seconds": time.monotonic() - started,
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    }
    (out / "result.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text()))
