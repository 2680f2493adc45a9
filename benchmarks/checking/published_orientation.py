"""Tables 4.15 and 4.17 to 4.19 of the published check: the relative orientation of matched points, and what it does to rays.

Strategy. Table 4.15 is repeated on the synthetic pair with the points that `published_matching` finds; all true angles are zero.
For the real pair, the printed orientation "from exterior" is taken as true, and points are made that fit it: 10843 matched ones
over the overlap, with random errors and with a smooth deformation of either photograph (film, scanner, interior orientation
measured in several packages); 18343 manual ones on 1500 x 1200 m, which the source had projected back with the orientation of the
plotter, so that they fit that one (the printed "manual" column) and not the true one. Every set is oriented by five rotations, and
intersected with all three orientations. The sizes of the errors are chosen so that sigma0 is the printed one.

Source: Skarlatos (sources/surface_check.md#relative-orientation), equations 4.17 and 4.18, tables 4.15 and 4.17 to 4.19.
"""

import numpy as np

from benchmarks.matching.dissertation_surface import CORNER, FLYING_HEIGHT, PIXEL, C
from orthomill.tasks.adjustment.solve.mixed_model import MixedSolution, solve_mixed
from orthomill.tasks.orientation.relative.relative_forms import FiveRotations

SYNTHETIC = {
    "kappa 1": (0.0010, 0.0031),
    "kappa 2": (0.0010, 0.0031),
    "phi 1": (0.0008, 0.0023),
    "phi 2": (0.0011, 0.0032),
    "omega 2": (0.0006, 0.0018),
}
"""table 4.15: degrees, and error on the ground (m), as printed"""
ANGLES = ("phi 1", "kappa 1", "omega 2", "phi 2", "kappa 2")
REAL = {
    "from exterior": (1.10752, 1.26136, -0.15349, 0.55063, 1.75359),
    "matched": (1.04400, 1.24551, -0.16050, 0.55192, 1.75579),
    "manual": (1.06914, 1.22570, -0.16059, 0.53437, 1.73879),
}
"""table 4.17, degrees; sigma0 20.8 and 1.1 micrometres"""
INTERSECTED = {
    "manual": {"matched": (14, 8), "manual": (9, 7), "from exterior": (13, 0.2)},
    "matched": {"matched": (16.5, 14.6), "manual": (24.4, 16.6), "from exterior": (9.3, 13.6)},
}
"""tables 4.18 and 4.19: mean and standard deviation of sigma0 by orientation, micrometres"""
REAL_C, REAL_BASE, REAL_HEIGHT, HALF_FRAME = 153.183, 1541.8621, 2604.0, 105.0
"""mm, m, m above the ground, mm"""
RANDOM, FILM, BACK = 0.0137, 0.014, 0.0008
"""mm: random error of a matched coordinate, root mean square of the deformation of a photograph, rounding of what was projected
back"""


def image_coordinates(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(N, 4) mm from pixels (N, 2) of the synthetic pair."""
    x = [(pixels[:, 0] + 0.5) * PIXEL - CORNER for pixels in (left, right)]
    y = [CORNER - (pixels[:, 1] + 0.5) * PIXEL for pixels in (left, right)]
    return np.column_stack([x[0], y[0], x[1], y[1]])


def synthetic_rows(left: np.ndarray, right: np.ndarray) -> list[str]:
    """Table 4.15 from matched pixels (N, 2): all true angles are zero."""
    known = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    observations = image_coordinates(left[known], right[known])
    # One-tailed 99 % on the y-parallax, as in table 4.13.
    parallax = np.abs(observations[:, 1] - observations[:, 3])
    found = solve_mixed(FiveRotations(C, C), observations[parallax <= parallax.mean() + 2.326 * parallax.std()])
    angles = dict(zip(("kappa 1", "kappa 2", "phi 1", "phi 2", "omega 2"), np.degrees(found.model.unknowns), strict=True))
    spread = dict(zip(angles, np.degrees(found.standard_errors), strict=True))
    lines = [_synthetic_row(name, angles[name], spread[name]) for name in SYNTHETIC]
    return [
        *lines,
        "",
        f"sigma0 of a y-parallax: {1e3 * parallax_sigma(found):.1f} micrometres (printed 1.4), {known.sum()} points.",
    ]


def _synthetic_row(name: str, angle: float, spread: float) -> str:
    degrees, ground = SYNTHETIC[name]
    on_ground = abs(np.radians(angle)) * FLYING_HEIGHT
    implied, needed = np.radians(degrees) * FLYING_HEIGHT, np.degrees(ground / FLYING_HEIGHT)
    ours = f"{angle:+.5f} | {spread:.5f} | {on_ground:.4f}"
    return f"| {name} | 0 | {ours} | {degrees:.4f} | {ground:.4f} | {implied:.4f} | {needed:.5f} |"


def parallax_sigma(found: MixedSolution[FiveRotations]) -> float:
    """sigma0 of a y-parallax, in the unit of the coordinates: the difference of two of them."""
    return float(np.sqrt(2.0) * found.sigma0)


def orientation_of(column: str) -> FiveRotations:
    """A column of table 4.17."""
    return FiveRotations(
        REAL_C, REAL_C, **{name.replace(" ", "_"): float(np.radians(v)) for name, v in zip(ANGLES, REAL[column], strict=True)}
    )


def seen(ground: np.ndarray, orientation: FiveRotations) -> np.ndarray:
    """Image coordinates (N, 4) mm of ground points (N, 3) m in the base system: x along the base, z up, origin on the left."""
    sides = []
    for rotation, shift in ((orientation.left, 0.0), (orientation.right, REAL_BASE)):
        ray = (ground - [shift, 0.0, 0.0]) @ rotation.T
        sides.append(-REAL_C * ray[:, :2] / ray[:, 2:])
    return np.hstack(sides)


def film(random: np.random.Generator, xy: np.ndarray) -> np.ndarray:
    """A smooth deformation (N, 2) mm of a photograph at coordinates (N, 2) mm: polynomials of the second and third order."""
    u, v = (xy / HALF_FRAME).T
    terms = np.column_stack([u * v, u**2, v**2, u**2 * v, u * v**2, u**3, v**3])
    out = terms @ random.normal(size=(terms.shape[1], 2))
    return FILM * out / out.std(axis=0)


def points() -> dict[str, np.ndarray]:
    """Image coordinates (N, 4) mm of both sets."""
    random = np.random.default_rng(17)
    reach = HALF_FRAME / REAL_C * REAL_HEIGHT
    plan = np.column_stack([random.uniform(REAL_BASE - reach, reach, 10843), random.uniform(-reach, reach, 10843)])
    matched = seen(np.column_stack([plan, random.normal(-REAL_HEIGHT, 15.0, len(plan))]), orientation_of("from exterior"))
    for side in (np.s_[:, :2], np.s_[:, 2:]):
        matched[side] += film(random, matched[side]) + random.normal(0.0, RANDOM, (len(matched), 2))
    plan = np.column_stack([random.uniform(20.0, 1520.0, 18343), random.uniform(-600.0, 600.0, 18343)])
    manual = seen(np.column_stack([plan, random.normal(-REAL_HEIGHT, 15.0, len(plan))]), orientation_of("manual"))
    return {"matched": matched, "manual": manual + random.normal(0.0, BACK, manual.shape)}


def oriented(sets: dict[str, np.ndarray]) -> dict[str, FiveRotations]:
    """Orientations of table 4.17: of both sets, and the one from exterior."""
    return {name: solve_mixed(FiveRotations(REAL_C, REAL_C), of_set).model for name, of_set in sets.items()} | {
        "from exterior": orientation_of("from exterior")
    }


def real_rows(sets: dict[str, np.ndarray]) -> list[str]:
    """Table 4.17."""
    found = {name: solve_mixed(FiveRotations(REAL_C, REAL_C), of_set) for name, of_set in sets.items()}
    lines = []
    for k, name in enumerate(ANGLES):
        field = name.replace(" ", "_")
        of_unknown = ("kappa 1", "kappa 2", "phi 1", "phi 2", "omega 2").index(name)
        ours = [np.degrees(getattr(found[s].model, field)) for s in ("matched", "manual")]
        spread = [np.degrees(found[s].standard_errors[of_unknown]) for s in ("matched", "manual")]
        cells = " | ".join(f"{a:.5f} | {s:.5f}" for a, s in zip(ours, spread, strict=True))
        printed = " | ".join(f"{REAL[s][k]:.5f}" for s in ("matched", "manual", "from exterior"))
        lines.append(f"| {name} | {cells} | {printed} |")
    sigmas = " | ".join(f"{1e3 * parallax_sigma(found[s]):.1f} | " for s in ("matched", "manual"))
    return [*lines, f"| sigma0, micrometres | {sigmas} | 20.8 | 1.1 | - |"]


def intersection_sigma(orientation: FiveRotations, observations: np.ndarray) -> np.ndarray:
    """sigma0 (N,) of the least-squares intersection of two rays, in the unit of the coordinates (N, 4).

    Four coordinates give three; what contradicts is the distance from coplanarity, and its least correction is the residual.
    """
    gap, _, slope = orientation.evaluate(observations)
    return np.abs(gap) / np.linalg.norm(slope, axis=1)


def intersection_rows(sets: dict[str, np.ndarray]) -> list[str]:
    """Tables 4.18 and 4.19."""
    lines, found = [], oriented(sets)
    for points_of in ("manual", "matched"):
        cells = []
        for name in ("matched", "manual", "from exterior"):
            sigma = 1e3 * intersection_sigma(found[name], sets[points_of])
            mean, std = INTERSECTED[points_of][name]
            cells.append(f"{sigma.mean():.1f} | {sigma.std():.1f} | {mean:g} | {std:g}")
        lines.append(f"| {points_of} | {' | '.join(cells)} |")
    return lines
