"""pyOrthomosaic, an open program that makes the products of a drone flight, run beside ours as its users run it.

It comes from PyPI into an environment of its own, for the time of one measurement: nothing of it is imported or kept. Its command
takes a folder of photographs; no setting is touched, so that all cores work and everything that it makes by default is made.
"""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio

from benchmarks.measured_run import MeasuredRun, measured_command
from orthomill.schemas.surface import MEASURED

PACKAGE = "pyorthomosaic==0.9.3"
_OWN_MEASURED = tuple(int(code) for code in MEASURED)
_PEER_MEASURED = (1,)
"""of dsm_support.tif: from its dense cloud; 2 is interpolated"""


@dataclass(frozen=True)
class Delivery:
    """What lies in a folder of products: the ground that its surface covers, and how much of it is measured, m^2; cells, m."""

    products: tuple[str, ...]
    surface: float
    measured: float
    surface_cell: float
    ortho: float
    ortho_cell: float


def peer_environment(folder: Path) -> Path:
    """The interpreter of a new environment with the program. Raises SystemExit with what pip says where it cannot be installed."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    done = subprocess.run([python, "-m", "pip", "install", "--quiet", PACKAGE], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{PACKAGE} cannot be installed:\n{done.stderr}")
    return python


def run_peer(python: Path, photographs: Path, products: Path) -> MeasuredRun:
    """All its products of a folder of photographs. Raises SystemExit with what it printed where it fails."""
    run = measured_command([python.parent / "orthomosaic-3d", photographs, "-o", products], products.parent)
    if run.code != 0:
        raise SystemExit(run.output)
    return run


def own_delivery(products: Path) -> Delivery:
    """What a run of ours left in its folder of products."""
    return _delivery(products, "dsm_provenance.tif", _OWN_MEASURED, "ortho.tif")


def peer_delivery(products: Path) -> Delivery:
    """What the other program left."""
    return _delivery(products, "dsm_support.tif", _PEER_MEASURED, "orthophoto.tif")


def _delivery(products: Path, codes: str, sure_codes: tuple[int, ...], ortho: str) -> Delivery:
    with rasterio.open(products / "dsm.tif") as heights, rasterio.open(products / codes) as support:
        cell = heights.res[0]
        known = heights.read(1, masked=True)
        covered = np.isfinite(known.filled(np.nan))
        sure = covered & np.isin(support.read(1), sure_codes)
    with rasterio.open(products / ortho) as image:
        ortho_cell, coloured = image.res[0], int((image.dataset_mask() > 0).sum())
    names = tuple(sorted(path.name for path in products.iterdir()))
    surface, measured = (float(mask.sum()) * cell**2 for mask in (covered, sure))
    return Delivery(names, surface, measured, cell, coloured * ortho_cell**2, ortho_cell)
