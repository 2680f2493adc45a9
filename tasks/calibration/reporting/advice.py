"""What is weak about a calibration, in plain sentences, and what to photograph instead.

Geometry first: how far the photographs are tilted against the plane of the boards, in how many directions, how far they are turned
about their axes, how much of the frame the corners cover. Then what the adjustment itself shows: correlations, halves that differ,
held-out residuals, boards that are not flat, photographs that are blurred or overexposed.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import some_of
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.board_tables import PhotoSearch
from orthomill.tasks.calibration.solving.calibration_precision import correlations
from orthomill.tasks.calibration.solving.model_choice import HeldOut
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.rotation import angles

CELLS = 8
"""The frame is divided into CELLS x CELLS for its coverage."""
_COVERED, _TILTED, _TURNED = 0.6, 10.0, 40.0
_TIED = 0.9
_BLURRED, _OVEREXPOSED = 2.5, 0.25


@dataclass(frozen=True)
class Geometry:
    """`tilt`: median and largest angle between photo and boards, `turned`: largest difference of kappa (0 to 90 degrees and
    beyond), both
    in degrees; `directions`: of four quadrants, in how many photos are tilted by 5 degrees or more; `coverage`: share of the
    frame."""

    tilt_median: float
    tilt_largest: float
    turned: float
    directions: int
    coverage: float


def geometry(result: BoardAdjustment, target: CalibrationTarget) -> Geometry:
    """How diverse the photographs are."""
    R = result.state.rotation
    tilt = np.degrees(np.arccos(np.clip(np.abs(R[:, 2, 2]), 0.0, 1.0)))
    side = np.arctan2(R[:, 2, 1], R[:, 2, 0])[tilt >= 5.0]
    kappa = np.array([angles(rotation)[2] for rotation in R])
    apart = np.abs(np.angle(np.exp(1j * (kappa[:, None] - kappa[None]))))
    return Geometry(
        float(np.median(tilt)), float(tilt.max()), float(np.degrees(apart.max())),
        len(np.unique(np.floor(side / (np.pi / 2)))), float(len(np.unique(frame_cells(result, target))) / CELLS**2),
    )  # fmt: skip


def frame_cells(result: BoardAdjustment, target: CalibrationTarget) -> np.ndarray:
    """Number of the cell of the frame for every corner used."""
    pixels = target.pixels(result.corners.xy[result.used])
    cell = np.clip((pixels / target.size * CELLS).astype(int), 0, CELLS - 1)
    return cell[:, 1] * CELLS + cell[:, 0]


def geometry_warnings(result: BoardAdjustment, shape: Geometry) -> list[str]:
    """What the arrangement of the photographs leaves undetermined, and how to mend it."""
    out = []
    if shape.tilt_largest < _TILTED:
        out.append(
            f"All photographs look straight down on the boards (largest tilt {shape.tilt_largest:.1f} degrees): c and the "
            f"distance Z0 "
            "cannot be separated; tilt the camera by 20 to 40 degrees in different directions."
        )
    elif shape.tilt_median < _TILTED:
        out.append(
            f"Most photographs look straight down on the boards (median tilt {shape.tilt_median:.1f} degrees): c and the "
            f"distance Z0 "
            "hang together; add photographs tilted by 20 to 40 degrees."
        )
    elif shape.directions < 3:
        out.append(
            "The photographs are tilted towards one side only: the principal point and the tilt hang together; tilt the camera "
            "towards all four sides."
        )
    if shape.turned < _TURNED:
        out.append(
            f"The camera was not turned about its axis (kappa differs by {shape.turned:.0f} degrees at most): x0 hangs together "
            f"with "
            "phi and y0 with omega; take some photographs turned by 90 degrees."
        )
    if shape.coverage < _COVERED:
        out.append(
            f"Corners fall into only {100 * shape.coverage:.0f} % of the frame's {CELLS} x {CELLS} cells; distortion elsewhere is "
            "extrapolated."
        )
    return out + _tied(result)


def _tied(result: BoardAdjustment) -> list[str]:
    table = correlations(result)
    pairs = [("c", "Z0"), ("x0", "phi"), ("y0", "omega"), ("x0", "omega"), ("y0", "phi"), ("x0", "X0"), ("y0", "Y0"), ("c", "phi")]
    strong = []
    for row, column in pairs:
        if row in table.rows:
            value = table.typical[table.rows.index(row), table.columns.index(column)]
            if value > _TIED:
                strong.append(f"{row} and {column} ({100 * value:.0f} %)")
    return [f"Strong correlations between interior and exterior orientation: {', '.join(strong)}."] if strong else []


def result_warnings(result: BoardAdjustment, check: HeldOut | None, target: CalibrationTarget) -> list[str]:
    """What residuals, halves and rejections say."""
    out = []
    if check is None:
        out.append("There are too few photographs of boards to check the calibration on some that take no part.")
    else:
        if check.rms > 1.5 * result.rms:
            out.append(
                f"Photographs that took no part fit {check.rms / result.rms:.1f} times worse than those that did; the standard "
                "errors of the interior orientation are too small by about as much."
            )
        name, ratio = check.worst
        if ratio > 4.0:
            out.append(
                f"Two halves of the photographs differ in {name} by {ratio:.1f} of its formal standard errors: formal precision "
                "flatters; take the difference of the halves for the precision."
            )
    share = float(1.0 - result.used.mean())
    if share > 0.05:
        out.append(
            f"{100 * share:.0f} % of the corners were rejected: look for boards that are not flat, moved between photographs, or "
            "are not all of one size."
        )
    scale = max(target.size) / 5000.0
    if result.sigma0 > max(1.0, 1.5 * scale):
        out.append(
            f"sigma0 is {result.sigma0:.2f} px, far more than corners are uncertain: the boards moved, are warped or of different "
            "size, the lens was refocused, or the distortion model does not suit the lens. Boards on an uneven floor want "
            "arrangement: space. The standard errors do not cover such faults: do not sign this calibration."
        )
    return out + _uneven_boards(result)


def _uneven_boards(result: BoardAdjustment) -> list[str]:
    """Boards whose residuals are much larger than those of the others."""
    size = np.linalg.norm(result.residual, axis=1)
    typical = [float(np.median(size[result.corners.board == board])) for board in range(result.network.boards)]
    middle = float(np.median(typical))
    bad = [str(board + 1) for board, value in enumerate(typical) if len(typical) > 2 and value > 2.5 * middle]
    return (
        [
            f"The residuals of board {', '.join(bad)} are more than 2.5 times those of the others: it is warped, of another "
            f"size, or moved."
        ]
        if bad
        else []
    )


def search_warnings(searches: tuple[PhotoSearch, ...]) -> list[str]:
    """Blurred and overexposed photographs, and boards with more corners than was said."""
    out = []
    blurred = [f"{s.photo} ({s.blur:.1f} px)" for s in searches if s.blur is not None and s.blur > _BLURRED]
    if blurred:
        out.append(
            f"Blurred, by the standard deviation of the edges of the squares: {some_of(blurred)}; use photographs in focus and "
            "without motion."
        )
    bright = [f"{s.photo} ({100 * s.overexposed:.0f} %)" for s in searches if s.overexposed > _OVEREXPOSED]
    if bright:
        out.append(
            f"Overexposed, by the share of the boards that is as bright as can be: {some_of(bright)}; bright squares grow and "
            "shift the corners, so expose less."
        )
    larger = [s.photo for s in searches if s.larger]
    if larger:
        out.append(
            f"Boards with more corners than stated were found and left out in {some_of(larger)}; check the number of inner corners."
        )
    other = Counter(size for s in searches for size in set(s.other))
    out += [f"Boards with {c} x {r} inner corners were seen in {n} photographs; is that the number?"
            for (c, r), n in other.items() if n > 1]  # fmt: skip
    return out
