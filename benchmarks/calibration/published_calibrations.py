"""Standard errors against the number of photographs, several boards beside a single large one: the published tables and ours.

`python -m benchmarks published_calibrations` writes benchmarks/results/published_calibrations.md. The
published photographs are not to be had: set-ups of the same boards, lens and number of photographs are simulated with the published
sigma0 as noise, and adjusted with the published five parameters and flat boards.

Source: Kawka 2021, tables 4-8, 4-16, 4-23, 4-36 (several boards), 4-38 to 4-48 (single boards, FAUCCAL)
(sources/calibration.md#results).
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.calibration.board_setups import FIVE_BOARDS, PUBLISHED, SIX_BOARDS, SIX_BOARDS_LONGER, TWELVE_BOARDS, BoardSetup
from benchmarks.calibration.calibration_accuracy import NOISE, corners_of
from benchmarks.calibration.horizon_pose import pose_by_horizon
from benchmarks.instrument.result_page import write_page
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.naming.board_names import name_boards, plane_views
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.calibration_precision import correlations
from orthomill.tasks.calibration.solving.conic_start import interior_from_conic
from orthomill.tasks.calibration.solving.initial_pose import pose_of_projection
from orthomill.tasks.simulation.boards.board_scene import BoardType

LARGE_BOARD = {"boards": 1, "board": BoardType((12, 9), 0.1, 0.02), "straight": True}
"""A single board of the extent of six, parallel to the floor's axes, as the published one"""
SINGLE = replace(SIX_BOARDS, name="six_boards, one board", **LARGE_BOARD)
SINGLE_LONGER = replace(SIX_BOARDS_LONGER, name="six_boards_longer, one board", **LARGE_BOARD)
NAMES = ("c", "x0", "y0", "k1", "k2")
DRAWS = 15
"""other photographs of the same set-up with which a table may begin"""


@dataclass(frozen=True)
class Published:
    """A published table: the set-up, and by the number of photographs the standard errors of c, x0, y0 (px), k1 (1e-10 px^-2), k2
    (1e-17 px^-4), and sigma0 (px)."""

    table: str
    setup: BoardSetup
    rows: dict[int, tuple[float, float, float, float, float, float]]


TABLES = (
    Published("4-8", TWELVE_BOARDS, {3: (1.8, 3.0, 3.6, 1.248, 1.765, 0.643), 7: (1.4, 2.6, 2.7, 0.830, 1.494, 0.945)}),
    Published(
        "4-16",
        FIVE_BOARDS,
        {
            3: (1.7, 2.0, 2.9, 1.042, 1.499, 0.454),
            6: (0.9, 1.0, 1.3, 0.574, 0.793, 0.463),
            12: (0.7, 0.6, 0.7, 0.327, 0.366, 0.477),
            21: (0.6, 0.4, 0.5, 0.235, 0.271, 0.457),
            34: (0.5, 0.4, 0.4, 0.182, 0.228, 0.467),
        },
    ),
    Published(
        "4-23",
        SIX_BOARDS,
        {
            3: (2.6, 1.7, 1.8, 1.603, 5.788, 0.256),
            5: (1.4, 1.4, 1.3, 1.469, 5.853, 0.337),
            8: (0.9, 0.8, 0.9, 1.139, 4.391, 0.353),
            11: (0.7, 0.6, 0.7, 0.893, 3.184, 0.358),
            14: (0.5, 0.6, 0.6, 0.662, 1.998, 0.383),
        },
    ),
    Published(
        "4-36",
        SIX_BOARDS_LONGER,
        {
            3: (2.6, 2.3, 2.4, 1.334, 3.598, 0.308),
            5: (1.1, 1.6, 1.7, 1.167, 3.370, 0.355),
            8: (0.9, 0.9, 1.2, 0.894, 2.758, 0.347),
            12: (0.7, 0.8, 1.0, 0.698, 2.184, 0.351),
            16: (0.6, 0.7, 0.7, 0.595, 1.749, 0.375),
        },
    ),
    Published(
        "4-40",
        SINGLE,
        {
            3: (1.7, 2.0, 1.9, 1.62, 6.73, 0.246),
            5: (1.2, 2.0, 2.2, 1.52, 6.08, 0.300),
            8: (0.9, 1.7, 1.8, 1.16, 4.77, 0.338),
            11: (0.6, 1.6, 1.3, 0.617, 1.81, 0.356),
        },
    ),
    Published(
        "4-46",
        SINGLE_LONGER,
        {
            3: (2.4, 2.1, 2.1, 1.21, 3.36, 0.332),
            5: (1.1, 1.6, 1.9, 0.858, 2.34, 0.313),
            8: (0.8, 1.5, 1.7, 0.747, 2.08, 0.333),
            11: (0.7, 1.4, 1.4, 0.639, 1.84, 0.345),
            14: (0.6, 1.1, 1.2, 0.600, 1.78, 0.365),
        },
    ),
)


def adjusted(setup: BoardSetup, photos: int, noise: float, seed: int = 0) -> BoardAdjustment:
    """The first photographs of a set-up, adjusted with five parameters."""
    corners = corners_of(replace(setup, photos=photos), noise, seed)
    return arrangement_of(corners.found, corners.target).result


def standard_errors(result: BoardAdjustment) -> np.ndarray:
    """(5,) formal, without the factor for correlated corners, in the units of the published tables."""
    c = result.state.interior[0]
    formal = np.sqrt(np.diag(result.interior_covariance))[:5] / result.correlated
    return formal * np.array([1.0, 1.0, 1.0, 1e10 / c**2, 1e17 / c**4])


def gain(sigma: np.ndarray) -> np.ndarray:
    """(5,): how many times smaller the standard errors of the last row are than those of the first."""
    return sigma[0] / sigma[-1]


def ours_of(table: Published) -> np.ndarray:
    """(R, 5) standard errors of the simulated photographs, one row for each published one."""
    return np.array([standard_errors(adjusted(table.setup, photos, row[5])) for photos, row in table.rows.items()])


def table_rows(table: Published) -> list[str]:
    """The lines of one table: published / ours, and at the end by how much the standard errors fall."""
    ours, published = ours_of(table), np.array([row[:5] for row in table.rows.values()])
    cells = [
        f"| {table.table} | {table.setup.name} | {photos} | "
        + " | ".join(f"{there:.3g} / {here:.3g}" for there, here in zip(*pair, strict=True))
        + " |"
        for photos, *pair in zip(table.rows, published, ours, strict=True)
    ]
    falls = " | ".join(f"{there:.1f} / {here:.1f}" for there, here in zip(gain(published), gain(ours), strict=True))
    return [*cells, f"| {table.table} | **falls by** | | {falls} |"]


def falls_of(table: Published) -> np.ndarray:
    """(n, 5): by how much the standard errors fall to those of the whole table when it begins with other photographs of it."""
    first, whole = min(table.rows), max(table.rows)
    corners = corners_of(replace(table.setup, photos=whole), table.rows[whole][5], 0)
    last = standard_errors(arrangement_of(corners.found, corners.target).result)
    random, falls = np.random.default_rng(1), []
    while len(falls) < DRAWS:
        chosen = [corners.found[k] for k in np.sort(random.permutation(whole)[:first])]
        try:
            falls.append(standard_errors(arrangement_of(chosen, corners.target).result) / last)
        except GeometryError:
            # Three photographs from one side do not determine a camera.
            continue
    return np.array(falls)


def fall_rows() -> list[str]:
    """Of every table the published falls, and the least, the median and the largest of those of other first photographs."""
    out = []
    for table in TABLES:
        there, here = gain(np.array([row[:5] for row in table.rows.values()])), falls_of(table)
        cells = (
            f"{printed:.1f} / {low:.1f}, {middle:.1f}, {high:.1f}"
            for printed, low, middle, high in zip(there, *np.quantile(here, (0.0, 0.5, 1.0), axis=0), strict=True)
        )
        out.append(f"| {table.table} | {min(table.rows)} of {max(table.rows)} | {' | '.join(cells)} |")
    return out


def correlation_rows() -> list[str]:
    """The largest correlations that the published text states, several boards and one, 11 and 14 photographs; the single boards
    from farther away as well, where they fill less of the frame."""
    out = []
    farther = [
        replace(one, name=f"{one.name}, {times:g} times as far", back=times)
        for one in (SINGLE, SINGLE_LONGER)
        for times in (1.5, 2.0)
    ]
    listed = ((SIX_BOARDS, 11), (SINGLE, 11), (SIX_BOARDS_LONGER, 14), (SINGLE_LONGER, 14))
    for setup, photos in (*listed, *((one, 11 if "longer" not in one.name else 14) for one in farther)):
        table = correlations(adjusted(setup, photos, 0.35))
        pairs = (("c", "Z0"), ("x0", "phi"), ("y0", "omega"), ("k1", "Z0"))
        cells = [f"{table.largest[table.rows.index(a), table.columns.index(b)]:.0%}" for a, b in pairs]
        out.append(f"| {setup.name} | {photos} | {' | '.join(cells)} |")
    return out


def start_rows(setups: tuple[BoardSetup, ...]) -> list[str]:
    """The published starts of c on the same photographs, and the poses by both methods, before any adjustment."""
    out = []
    for setup in setups:
        noise = NOISE[setup.name]
        corners = corners_of(setup, noise, 0)
        target, known = corners.target, arrangement_of(corners.found, corners.target)
        # Named in measured coordinates: those of the arrangement are free of distortion, and centred.
        naming = name_boards(plane_views(corners.found, target.local, target.orders), target.local, target.boards)
        projections = [own.projection for own in naming.photos if own.projection is not None]
        planes = [projection[:, [0, 1, 3]] for projection in projections]
        whole = interior_from_conic(planes, float(max(target.size)))
        true, c = setup.camera, known.constant.c
        both = zip(planes, projections, strict=True)
        apart = [np.linalg.norm(pose_by_horizon(plane, c)[1] - pose_of_projection(own, c)[1]) for plane, own in both]
        out.append(
            f"| {setup.name} | {true.c:.1f} | {c:.1f} | {whole.c:.1f} | {whole.x0 - true.x0:+.1f}, {whole.y0 - true.y0:+.1f} | "
            f"{np.median(apart):.4f} | {known.result.state.interior[0]:.1f} | {known.iterations} |"
        )
    return out


def page() -> str:
    """The whole page."""
    columns = " | ".join(f"sigma {name}" for name in NAMES)
    return "\n".join(
        [
            "# Published calibrations against the number of photographs",
            "",
            "Published / simulated. k1 in 1e-10 px^-2, k2 in 1e-17 px^-4. The published photographs are others (their layout is "
            "not stated), so that orders and rates compare, not digits. Published single boards were adjusted with FAUCCAL.",
            "",
            f"| table | set-up | photographs | {columns} |",
            "| --- " * 8 + "|",
            *(line for table in TABLES for line in table_rows(table)),
            "",
            "## Falls with other first photographs",
            "",
            f"Which photographs a table begins with is not printed. {DRAWS} random draws of as many from all of the last row: "
            "published / least, median, largest fall.",
            "",
            "| table | photographs | " + " | ".join(f"sigma {name}" for name in NAMES) + " |",
            "| --- " * 7 + "|",
            *fall_rows(),
            "",
            "## Correlations, largest over the photographs",
            "",
            "Published: one board c with Z0 above 60 %, x0 with phi above 80 to 85 %, y0 with omega above 80 %; several boards 50 "
            "to 60 % for x0 with phi and y0 with omega; k with exterior orientation below 25 %.",
            "",
            "| set-up | photographs | c, Z0 | x0, phi | y0, omega | k1, Z0 |",
            "| --- " * 6 + "|",
            *correlation_rows(),
            "",
            "## Starts",
            "",
            "c by the published rule over photographs (S8), by the whole conic (S7), whose principal point is only looked at here, "
            "and the median distance (m) of the projection centres by the horizon (S9) from those that are used (S10).",
            "",
            "| set-up | true c | S8 | S7 | error of its x0, y0 | S9 from S10 (m) | adjusted c | iterations |",
            "| --- " * 8 + "|",
            *start_rows(PUBLISHED),
            "",
        ]
    )


def main(words: list[str]) -> None:
    """Measure and write the page."""
    write_page("published_calibrations", words, page())
