"""Nine simulated scans round a building, with targets between them and a few surveyed ones."""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.adjustment.registration.scan_network import ScannedPoints, ScanNetwork
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector


class ScannedSite(NamedTuple):
    """What the surveyor has, and the truth: `rotation` (S, 3, 3), `translation` (S, 3), `point` (P, 3)."""

    network: ScanNetwork
    points: ScannedPoints
    names: tuple[str, ...]
    rotation: np.ndarray
    translation: np.ndarray
    point: np.ndarray


def scanned_site(
    seed: int, scans: int = 9, targets: int = 40, surveyed: int = 8, noise: float = 0.004, control_noise: float = 0.002
) -> ScannedSite:
    """Scans stand in a circle of 25 m, levelled to a degree; each measures the targets within 30 m with errors of `noise` m."""
    generator = np.random.default_rng([seed, 9])
    angle = 2.0 * np.pi * np.arange(scans) / scans
    # Far from the origin, as national systems are.
    middle = np.array([478000.0, 4203000.0, 120.0])
    stand = middle + np.column_stack([25 * np.cos(angle), 25 * np.sin(angle), generator.normal(0, 0.5, scans)])
    point = middle + generator.uniform([-22, -22, -1], [22, 22, 9], (targets, 3))
    tilt = generator.normal(0.0, 0.02, (scans, 3)) + np.outer(generator.uniform(0, 6, scans), [0, 0, 1])
    rotation = np.array([rotation_of_vector(w) for w in tilt])
    scan, number = np.nonzero(np.linalg.norm(point[None] - stand[:, None], axis=2) < 30.0)
    true = np.einsum("mji,mj->mi", rotation[scan], point[number] - stand[scan])
    sigma = np.full(len(scan), max(noise, 1e-3))
    points = ScannedPoints(scan, number, true + generator.normal(0.0, noise, true.shape), sigma)
    weight = np.zeros((targets, 3))
    weight[:surveyed] = max(control_noise, 1e-3) ** -2.0
    network = ScanNetwork(scans, targets, point + generator.normal(0.0, control_noise, point.shape), weight)
    return ScannedSite(network, points, tuple(f"scan_{k + 1}" for k in range(scans)), rotation, stand, point)
