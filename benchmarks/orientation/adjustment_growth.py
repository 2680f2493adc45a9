"""How the adjustment grows with the number of photographs of a simulated drone block.

`python -m benchmarks adjustment_growth [against=FOLDER]` measures blocks of 50 to 1000 photographs, each in a process
of its own, and writes benchmarks/results/adjustment_growth.md; FOLDER: another checkout, which adjusts 200 photographs beside this
one. `python -m benchmarks adjustment_growth STRIPS PHOTOS POINTS` measures one block and prints a line of JSON.
"""

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT
from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.network import Interior, Network, Rays, State
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

CAMERA = np.array([[4000.0, 3.0, -2.0, -0.05, 0.02, 0.0, 1e-4, -1e-4]])
SIGMA_CAMERA = np.array([20.0, 10.0, 10.0, 0.02, 0.02, 0.0, 1e-3, 1e-3])
HALF_FRAME = (3000.0, 4000.0)
GNSS, NOISE, WRONG = 0.05, 0.3, 0.01
SIZES = ((5, 10, 25_000), (10, 10, 50_000), (10, 20, 100_000), (20, 20, 200_000), (25, 40, 500_000))
"""Strips, photographs in a strip, points of the study."""
COMPARED = SIZES[2]


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
    xy = -residuals(truth, rays, np.zeros(len(truth.centre), np.int64)) + NOISE * rng.standard_normal((len(rows), 2))
    wrong = rng.random(len(rows)) < WRONG
    xy[wrong] += rng.uniform(-50, 50, (wrong.sum(), 2))
    return replace(rays, xy=xy)


def measured(strips: int, per: int, points: int) -> dict:
    """The figures of one adjustment; compiles on a small block first."""
    adjust(*flight(1, 4, 200))
    network, start, rays = flight(strips, per, points)
    clock, cpu = time.perf_counter(), time.process_time()
    result = adjust(network, start, rays)
    return {
        "photos": network.photos,
        "points": points,
        "rays": len(rays),
        "seconds": time.perf_counter() - clock,
        "cpu": time.process_time() - cpu,
        "iterations": result.iterations,
        "sigma0": result.sigma0_px,
        "gibibytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def _row(folder: Path, size: tuple[int, int, int]) -> str:
    """A row of the table, measured with the sources of `folder` in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.orientation.adjustment_growth", *map(str, size)]
    own = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    told = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True, env=own)
    r = json.loads(told.stdout.splitlines()[-1])
    return (
        f"| {r['photos']} | {r['points']} | {r['rays']} | {r['seconds']:.1f} | {r['cpu']:.1f} | "
        f"{1000 * r['cpu'] / r['photos']:.0f} | {r['iterations']} | {r['gibibytes']:.2f} | {r['sigma0']:.6f} |"
    )


def study(words: list[str], against: Path | None) -> None:
    """Measure all sizes and write the page."""
    head = [
        "| photographs | points | rays | seconds | CPU-seconds | CPU-ms each | iterations | peak GiB | sigma0 (true 0.3) |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    beside = []
    if against is not None:
        log = subprocess.run(["git", "log", "-1", "--format=%h"], cwd=against, capture_output=True, text=True, check=True)
        title = f"## Beside commit {log.stdout.strip()}, in one run"
        both = _row(against, COMPARED), _row(ROOT, COMPARED)
        beside = [title, "", "First that commit, then this one.", "", *head, *both, ""]
    rows = [_row(ROOT, size) for size in SIZES]
    write_page(
        "adjustment_growth",
        words,
        "\n".join(
            [
                "# Growth of the adjustment with the number of photographs",
                "",
                "Photographs of a drone, every 60 m in strips 120 m apart, 150 m x 200 m on the ground; one camera "
                "with seven interior parameters, GNSS positions, 1 % of the rays wrong by up to 50 px; robust start, "
                "tests, variance components and covariance included; one process, one thread, compiled kernels from "
                "the cache. Seconds are those of a machine that others used, too; CPU-seconds are what the work "
                "takes. The peak is that of the whole process, libraries and simulated data included.",
                "",
                *head,
                *rows,
                "",
                "Wanted: 200 photographs and 100 thousand points below 60 s and 2 GiB; 1000 photographs on a laptop.",
                "",
                *beside,
            ]
        ),
    )


def main(words: list[str]) -> None:
    """The study; with three numbers one block, as a line of JSON."""
    if len(words) == 3:
        print(json.dumps(measured(*map(int, words))))
        return
    study(words, next((Path(word.removeprefix("against=")).resolve() for word in words if word.startswith("against=")), None))


if __name__ == "__main__":
    main(sys.argv[1:])
