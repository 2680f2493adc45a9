"""The picture of the README from a finished run: `python -m benchmarks.readme_picture runs/volos docs/pictures/volos.png`.

Surface, its check, coverage and orthoimage side by side, drawn by the report's own painters.
"""

import base64
import sys
from pathlib import Path

import cv2
import numpy as np

from orthomill.pipeline.report.pictures import draw
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.stage_report import Picture, StageReport, report_table

SHOWN = ("densification/height", "dsm_check/dh", "texture/coverage", "texture/ortho")
SIDE = 620
GAP = 12


def drawn(store: Store, raster: str) -> np.ndarray:
    """The picture of a raster as its stage shows it in the report, (rows, cols, 3) BGR."""
    report: StageReport = store.table(report_table(raster.split("/")[0]))
    picture: Picture = next(picture for picture in report.pictures if picture.raster == raster)
    encoded = draw(store, picture, SIDE).uri.split(",")[1]
    image = cv2.imdecode(np.frombuffer(base64.b64decode(encoded), np.uint8), cv2.IMREAD_UNCHANGED)
    if image.shape[2] == 3:
        return image
    share = image[..., 3:] / 255.0
    return (image[..., :3] * share + 255 * (1 - share)).astype(np.uint8)


def main() -> None:
    """Draw, put side by side, write."""
    store = Store(Path(sys.argv[1]))
    images = [drawn(store, raster) for raster in SHOWN]
    height, width = max(image.shape[0] for image in images), max(image.shape[1] for image in images)
    sheet = np.full((2 * height + GAP, 2 * width + GAP, 3), 255, np.uint8)
    for number, image in enumerate(images):
        row, col = number // 2 * (height + GAP), number % 2 * (width + GAP)
        sheet[row : row + image.shape[0], col : col + image.shape[1]] = image
    target = Path(sys.argv[2])
    target.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(target), sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
