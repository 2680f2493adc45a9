"""One adjustment of a simulated block in a process of its own: `python -m benchmarks.adjustment_growth STRIPS PHOTOS POINTS`.

Prints a line of JSON: photographs, points, rays, seconds, CPU-seconds, iterations, peak memory.
"""

import json
import resource
import sys
import time
from dataclasses import replace

import numpy as np

from tasks.adjustment.bundle import adjust
from tasks.adjustment.collinearity import misclosures
from tasks.adjustment.network import Interior, Network, Rays, State
from tasks.geometry.rotation import rotation_matrix
from tasks.geometry.rotation_vector import rotation_of_vector

CAMERA = np.array([[4000.0, 3.0, -2.0, -0.05, 0.02, 0.0, 1e-4, -1e-4]])
SIGMA_CAMERA = np.array([20.0, 10.0, 10.0, 0.02, 0.02, 0.0, 1e-3, 1e-3])
HALF_FRAME = (3000.0, 4000.0)
GNSS, NOISE, WRONG = 0.05, 0.3, 0.01


def flight(strips: int, per: int, points: int, seed: int = 0) -> tuple[Network, State, Rays]:
    """A drone block: photographs every 60 m in strips 120 m apart, 100 m above ground; the network, a rough start, the rays."""
    rng = np.random.default_rng(seed)
    centre = np.array([(60.0 * j, 120.0 * i, 100 + rng.normal(0, 1)) for i in range(strips) for j in range(per)])
    kappa = np.repeat(np.where(np.arange(strips) % 2, np.pi, 0.0), per)
    rotation = np.array([rotation_matrix(*(0.02 * rng.standard_normal(2)), k) for k in kappa])
    low, high = (-60, -60), (60 * per, 120 * strips - 60)
    ground = np.column_stack([rng.uniform(low, high, (points, 2)), rng.normal(0, 5, points)])
    truth = State(rotation, centre, ground, CAMERA, np.zeros(3))
    rays = _rays(truth, rng)
    free = SIGMA_CAMERA[None] > 0
    weight = np.zeros((1, 8, 8))
    weight[0][np.ix_(free[0], free[0])] = np.diag(1.0 / SIGMA_CAMERA[free[0]] ** 2)
    interior = Interior(CAMERA, weight, free, np.zeros_like(free))
    measured, weights = centre + GNSS * rng.standard_normal(centre.shape), np.full(centre.shape, 1.0 / GNSS**2)
    nothing = np.zeros((points, 3))
    network = Network(np.zeros(len(centre), np.int64), interior, measured, weights, nothing, nothing, np.zeros(len(centre)))
    rough = replace(
        truth,
        centre=centre + rng.normal(0, 0.5, centre.shape),
        point=ground + rng.normal(0, 0.5, ground.shape),
        rotation=np.array([rotation_of_vector(0.003 * rng.standard_normal(3)) @ R for R in rotation]),
    )
    return network, rough, rays


def _rays(truth: State, rng: np.random.Generator) -> Rays:
    found = []
    for photo, (R, centre) in enumerate(zip(truth.rotation, truth.centre, strict=True)):
        u = (truth.point - centre) @ R.T
        xy = np.abs(CAMERA[0, 0] * u[:, :2] / u[:, 2:])
        seen = np.flatnonzero((xy < HALF_FRAME).all(axis=1) & (u[:, 2] < 0))
        found.append(np.column_stack([seen, np.full(len(seen), photo)]))
    rows = np.vstack(found)
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    rows = rows[np.bincount(rows[:, 0], minlength=len(truth.point))[rows[:, 0]] >= 2].astype(np.int32)
    rays = Rays(rows[:, 0].copy(), rows[:, 1].copy(), np.zeros((len(rows), 2)), np.full(len(rows), NOISE))
    xy = -misclosures(truth, rays, np.zeros(len(truth.centre), np.int64)) + NOISE * rng.standard_normal((len(rows), 2))
    wrong = rng.random(len(rows)) < WRONG
    xy[wrong] += rng.uniform(-50, 50, (wrong.sum(), 2))
    return replace(rays, xy=xy)


def main() -> None:
    """Compile on a small block, then measure."""
    strips, per, points = map(int, sys.argv[1:4])
    adjust(*flight(1, 4, 200))
    network, start, rays = flight(strips, per, points)
    clock, cpu = time.perf_counter(), time.process_time()
    result = adjust(network, start, rays)
    told = {
        "photos": network.photos, "points": points, "rays": len(rays), "seconds": time.perf_counter() - clock,
        "cpu": time.process_time() - cpu, "iterations": result.iterations, "sigma0": result.sigma0_px,
        "gibibytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }  # fmt: skip
    print(json.dumps(told))


if __name__ == "__main__":
    main()
