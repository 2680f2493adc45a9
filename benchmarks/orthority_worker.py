"""Orthoimages of single photographs by orthority, run by the Python that has it: `python orthority_worker.py task.json`.

Prints, as JSON, the CPU-seconds and the pixels that carry a colour, and leaves one GeoTIFF per photograph. Nothing of orthomill is
imported, for orthority lives in an environment of its own.
"""

import json
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import rasterio
from orthority import Ortho
from orthority.camera import BrownCamera
from orthority.enums import Interp


def camera_of(photo: dict) -> BrownCamera:
    """The camera of one photograph; y0 and the rows point in opposite directions."""
    width, height = photo["size"]
    longer = max(width, height)
    lens = {name: photo[name] for name in ("k1", "k2", "k3", "p1", "p2")}
    return BrownCamera(
        (width, height),
        photo["c"],
        sensor_size=(float(width), float(height)),
        cx=photo["x0"] / longer,
        cy=-photo["y0"] / longer,
        xyz=tuple(photo["centre"]),
        opk=tuple(np.radians(photo["omega_phi_kappa"])),
        **lens,
    )


def main() -> None:
    """Orthorectify every photograph of the task."""
    # One thread, so that CPU time is what one core needs: orthority starts as many as there are cores, which wait for each other.
    cv2.setNumThreads(1)
    os.cpu_count = lambda: 1
    task = json.loads(Path(sys.argv[1]).read_text())
    seconds, pixels = 0.0, 0
    for photo in task["photos"]:
        ortho = Ortho(photo["file"], task["dem"], camera_of(photo), crs=task["crs"])
        path = Path(task["folder"]) / f"orthority_{photo['name']}.tif"
        started = time.process_time()
        ortho.process(
            path,
            resolution=(task["cell"], task["cell"]),
            interp=Interp.cubic,
            dem_interp=Interp.bilinear,
            build_ovw=False,
            creation_options={"tiled": True},
            overwrite=True,
            aligned_pixels=True,
        )
        seconds += time.process_time() - started
        with rasterio.open(path) as image:
            pixels += int((image.dataset_mask() > 0).sum())
    print(json.dumps({"seconds": seconds, "pixels": pixels}))


if __name__ == "__main__":
    main()
