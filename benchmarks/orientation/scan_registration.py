"""Joint registration of nine simulated scans over many seeds: are its standard errors true, and does it name what is wrong?"""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.orientation.scanned_site import ScannedSite, scanned_site
from orthomill.tasks.adjustment.registration.joint_registration import Registration, register
from orthomill.tasks.geometry.rotation_vector import vector_of_rotation

SEEDS = 300
NOISE = 0.004
"""m, of a coordinate of a scanned target"""
BLUNDER = 0.15
"""m: how far one target of a scan is moved"""


def main(words: list[str]) -> None:
    """Measure, print and write the table."""
    began = time.process_time()
    lines = "\n".join(_rows())
    seconds = time.process_time() - began
    write_page(
        "scan_registration",
        words,
        f"# Joint registration of scans\n\n{SEEDS} seeds of nine scans round a building ({seconds:.0f} CPU-s): "
        "40 targets, 8 surveyed to 2 mm, 4 mm in a coordinate of a scanned target.\n\n"
        f"| what | figure | wanted |\n| --- | --- | --- |\n{lines}\n",
    )


def _rows() -> Iterator[str]:
    sites = [scanned_site(seed, noise=NOISE) for seed in range(SEEDS)]
    found = [register(site.network, site.points, site.names) for site in sites]
    scan = np.concatenate([_scan_errors(*pair) for pair in zip(sites, found, strict=True)])
    point = np.concatenate([_point_errors(*pair) for pair in zip(sites, found, strict=True)])
    sigma0 = np.sqrt(np.mean([one.sigma0**2 for one in found])) / NOISE
    away = max(abs(np.linalg.det(R) - 1.0) for one in found for R in one.state.rotation)
    yield f"| places and rotations of scans within 1 / 2 / 3 standard errors | {_within(scan)} | 68.3 / 95.4 / 99 % |"
    yield f"| coordinates of registered targets within 1 / 2 / 3 | {_within(point)} | 68.3 / 95.4 / 99 % |"
    yield f"| sigma0, estimated over true | {sigma0:.4f} | within 3 % |"
    yield f"| det R - 1, largest | {away:.1e} | 0 |"
    yield f"| targets rejected where none is wrong | {sum(len(one.blunders) for one in found)} of {_targets(sites)} | |"
    named = sum(_is_named(site, seed) for seed, site in enumerate(sites))
    yield f"| one target moved by {1000 * BLUNDER:.0f} mm in one scan: just it is named | {100 * named / SEEDS:.1f} % | |"


def _targets(sites: list[ScannedSite]) -> int:
    return sum(len(site.points) for site in sites)


def _within(errors: np.ndarray) -> str:
    return " / ".join(f"{100 * (np.abs(errors) < limit).mean():.1f}" for limit in (1, 2, 3)) + " %"


def _scan_errors(site: ScannedSite, found: Registration) -> np.ndarray:
    """Errors of translations and rotations in standard errors."""
    out = []
    for k in range(len(site.names)):
        turn = vector_of_rotation(found.state.rotation[k] @ site.rotation[k].T)
        away = np.concatenate([found.state.translation[k] - site.translation[k], turn])
        out.append(away / np.sqrt(np.diag(found.scan_covariance(k))))
    return np.concatenate(out)


def _point_errors(site: ScannedSite, found: Registration) -> np.ndarray:
    shown = np.unique(site.points.point)
    sigma = np.sqrt(np.diagonal(found.point_covariance, axis1=1, axis2=2))
    return ((found.state.point - site.point)[shown] / sigma[shown]).ravel()


def _is_named(site: ScannedSite, seed: int) -> bool:
    """Whether just the one wrong target is rejected, in just its scan; one that three scans or more show."""
    generator = np.random.default_rng([seed, 17])
    often = np.bincount(site.points.point, minlength=site.network.points)[site.points.point] >= 3
    row = int(generator.choice(np.flatnonzero(often)))
    direction = generator.normal(size=3)
    xyz = site.points.xyz.copy()
    xyz[row] += BLUNDER * direction / np.linalg.norm(direction)
    found = register(site.network, replace(site.points, xyz=xyz), site.names).blunders
    wanted = (int(site.points.point[row]), (int(site.points.scan[row]),))
    return [(one.point, one.scans) for one in found] == [wanted]
