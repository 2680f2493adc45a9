"""The gallery of docs/gallery.md: faults that surfaces have, planted into a right one, and what the check says of each.

    python -m benchmarks gallery [runs/volos_small [FAULT ...]]

Pictures: what is wrong, corrections that the photographs ask for, codes. Written to docs/pictures/wrong, with the sentences of the
check beside them as `found.json`.
"""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.windows import Window
from scipy.ndimage import gaussian_filter

from benchmarks.checking.check_picture import picture
from benchmarks.instrument.result_page import ROOT
from benchmarks.measured_run import orthomill, run_folders
from orthomill.schemas.surface import CheckCode

PAGE = ROOT / "docs" / "gallery.md"
TARGET = ROOT / "docs" / "pictures" / "wrong"
_PART = (190, 160, 250, 210)
"""cells of the surface that are shown: first column and row, columns and rows"""
REACH = 1.5
"""m of full colour"""


def shifted(z: np.ndarray) -> np.ndarray:
    """Another height system."""
    return z + np.float32(0.8)


def tilted(z: np.ndarray) -> np.ndarray:
    """One wrong control point at the edge: from -1.2 m in the west to 1.2 m in the east."""
    return z + np.linspace(-1.2, 1.2, z.shape[1], dtype=np.float32)


def domed(z: np.ndarray) -> np.ndarray:
    """A wrong lens: the middle is 1.2 m too high."""
    row, col = np.mgrid[: z.shape[0], : z.shape[1]]
    far = np.hypot(row - z.shape[0] / 2, col - z.shape[1] / 2) / (np.hypot(*z.shape) / 2)
    return (z + 1.2 * (1 - far**2)).astype(np.float32)


def melted(z: np.ndarray) -> np.ndarray:
    """Smoothed away: roofs without edges."""
    known = np.isfinite(z)
    weight = gaussian_filter(known.astype(np.float32), 5)
    smooth = gaussian_filter(np.where(known, z, 0), 5) / np.maximum(weight, 1e-6)
    return np.where(known, smooth, np.nan).astype(np.float32)


def rebuilt(z: np.ndarray) -> np.ndarray:
    """An old model: four houses stand that are not there, and a strip of ground lies 2 m deeper."""
    out, (rows, cols) = z.copy(), z.shape
    for row, col in ((0.15, 0.2), (0.2, 0.7), (0.75, 0.3), (0.7, 0.75)):
        place = np.s_[int(row * rows) : int(row * rows) + 16, int(col * cols) : int(col * cols) + 24]
        out[place] = np.nanmedian(out[place]) + 6
    out[int(0.45 * rows) : int(0.45 * rows) + 14, cols // 4 : 3 * cols // 4] -= 2
    return out


_HEAD = "| fault | height of all, m (standard error) | tilt, m | scatter, m | judged, % | corrected, % |"
_FIGURES = ("shift_up", "shift_up_sigma", "trend_range", "checked", "dh_nmad", "changed", "suspicious_areas")
"""of the report, that tell of such faults"""

FAULTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "shifted": shifted,
    "tilted": tilted,
    "domed": domed,
    "melted": melted,
    "rebuilt": rebuilt,
}


def main(words: list[str]) -> None:
    """Plants each fault, or those that are named after the run, runs the command on it, and draws."""
    run = run_folders(words[:1] or ["runs/volos_small"])[0]
    TARGET.mkdir(parents=True, exist_ok=True)
    kept = TARGET / "found.json"
    for name in words[1:] or FAULTS:
        found = json.loads(kept.read_text()) if kept.is_file() else {}
        found[name] = _checked(run, name, _planted(run, name, FAULTS[name]))
        kept.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n")
        PAGE.write_text(with_figures(PAGE.read_text(), found))


def table(found: dict[str, dict[str, float | None]]) -> str:
    """What the check found of each fault, as the page shows it."""
    lines = [_HEAD, "| --- | --- | --- | --- | --- | --- |"]
    for name in (name for name in FAULTS if name in found):
        f = found[name]
        shift = f"{f['shift_up']:+.2f} ({f['shift_up_sigma']:.2f})"
        lines.append(
            f"| {name} | {shift} | {f['trend_range']:.2f} | {f['dh_nmad']:.2f} | {f['checked']:.0f} | {f['changed']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def with_figures(page: str, found: dict[str, dict[str, float | None]]) -> str:
    """The page with the table of these figures in place of the one that it has."""
    before, _, rest = page.partition(_HEAD)
    return f"{before}{table(found)}\n{rest.partition(chr(10) * 2)[2]}"


def _planted(run: Path, name: str, fault: Callable[[np.ndarray], np.ndarray]) -> Path:
    """The surface with a fault, beside the run."""
    path = run.parent / f"gallery_{name}.tif"
    with rasterio.open(run / "products" / "dsm.tif") as source:
        profile = {key: source.profile[key] for key in ("width", "height", "crs", "transform", "nodata", "dtype")}
        part = Window(*_PART)
        wrong = fault(source.read(1, window=part))
        profile |= {"width": part.width, "height": part.height, "transform": source.window_transform(part)}
    with rasterio.open(path, "w", driver="GTiff", count=1, **profile) as target:
        target.write(wrong, 1)
    return path


def _checked(run: Path, name: str, surface: Path) -> dict[str, float | None]:
    """Runs the check and draws it; figures of its report by name."""
    root, checked = run.parent.parent, f"gallery-{name}"
    done = orthomill(root, "check", str(surface), "--project", run.name, "--name", checked, "--sequential")
    if done.code != 0:
        raise SystemExit(f"The check of {surface} ended with {done.code}:\n{done.output[-2000:]}")
    # What the command leaves beside other projects: neither is one.
    (root / "workflows" / f"{checked}.yaml").unlink(missing_ok=True)
    surface.unlink()
    products = root / "runs" / checked / "products"
    with rasterio.open(products / "dsm_check.tif") as product:
        band = {text.split(" ")[0]: k + 1 for k, text in enumerate(product.descriptions)}
        dh, code = product.read(band["dh"]), product.read(band["code"], masked=True).filled(CheckCode.EMPTY)
    drawn = picture(dh, np.nan_to_num(code), REACH)
    cv2.imwrite(str(TARGET / f"{name}.jpg"), cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])
    summary = json.loads((products.parent / "summary.json").read_text())
    return {figure: summary[f"dsm_check.{figure}"]["value"] for figure in _FIGURES}
