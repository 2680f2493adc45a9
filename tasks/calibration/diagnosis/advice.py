"""Weaknesses of a calibration, as codes with their numbers; `advice_sentences.py` puts them into words.

Geometry first: how far the photographs are tilted against the plane of the boards, in how many directions, how far they are turned
about their axes, how much of the frame the corners cover. Then what the adjustment shows: correlations, halves that differ,
held-out residuals, boards that are not flat, photographs that are blurred or overexposed.
"""

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.calibration.board_tables import PhotoSearch
from orthomill.tasks.calibration.solving.calibration_precision import correlations, largest_bend
from orthomill.tasks.calibration.solving.model_choice import HeldOut
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.rotation import angles

CELLS = 8
"""The frame is divided into CELLS x CELLS for its coverage."""
# Below 10 degrees of tilt c and Z0 are correlated beyond 90 %; the published hard cases had 5 photographs below 8 degrees.
_COVERED, _TILTED, _TURNED = 0.6, 10.0, 40.0
"""Least share of the cells with corners, least tilt and least range of kappa (degrees)."""
_SIDEWAYS = 5.0
"""degrees: a smaller tilt has no direction that matters"""
_STRONG = 0.9
"""Correlation above which two unknowns are hardly separated."""
_BLURRED, _OVEREXPOSED = 2.5, 0.25
"""px of the standard deviation of edges, and share of saturated pixels: half of the white squares."""
_WORSE, _HALVES, _REJECTED, _UNEVEN = 1.5, 2.5, 0.05, 2.5
"""Largest ratio of held-out to used residuals; of the halves' difference to its standard error; share of rejected corners; ratio of
one board's residuals to those of the others."""

_SQUARE, _SURE = 0.002, 4.0
"""Pixels of digital cameras are square to better than this; a departure is believed from so many standard errors on."""
_UNCERTAIN = 0.005
"""Standard error of c, in units of c, above which heights from this camera are worth little."""
_BENT, _CERTAIN = 2.0, 4.0
"""A bend is said that is so many times as large as was expected, and so many of its standard errors."""


class Weakness(StrEnum):
    """What may be wrong with a calibration."""

    NO_TILT = "no tilt"
    LITTLE_TILT = "little tilt"
    ONE_SIDED_TILT = "one-sided tilt"
    NOT_TURNED = "not turned"
    LITTLE_COVERAGE = "little coverage"
    STRONG_CORRELATION = "strong correlation"
    NOT_CHECKED = "not checked"
    HELD_OUT_WORSE = "held-out worse"
    HALVES_DIFFER = "halves differ"
    MANY_REJECTED = "many rejected"
    LARGE_SIGMA0 = "large sigma0"
    UNEVEN_BOARDS = "uneven boards"
    BENT_BOARD = "bent board"
    REJECTED_OUTSIDE = "rejected outside"
    REJECTED_TOGETHER = "rejected together"
    ALL_WORSE = "all corners worse"
    BLURRED = "blurred"
    OVEREXPOSED = "overexposed"
    LARGER_BOARDS = "larger boards"
    OTHER_BOARDS = "other boards"
    NOT_SQUARE = "pixels not square"
    UNDETERMINED = "coefficients undetermined"
    CONSTANT_UNCERTAIN = "constant uncertain"


_NOTED = (Weakness.BENT_BOARD, Weakness.BLURRED, Weakness.OVEREXPOSED, Weakness.OTHER_BOARDS, Weakness.LARGER_BOARDS)
LIMITING = frozenset(Weakness).difference(_NOTED)
"""Weaknesses that limit what the camera may be used for; the others are good to know"""


@dataclass(frozen=True)
class Advice:
    """A weakness with its numbers.

    `value`: the figure that is too large or too small, in the unit of its sentence; `names`: photographs, boards, parameters or
    pairs of parameters concerned, and `values` their figures; `corners`: columns and rows of boards of another kind.
    """

    code: Weakness
    value: float = 0.0
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    corners: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class PhotoGeometry:
    """How diverse the photographs are.

    Tilt: median and largest angle between photo and boards, degrees; `turned`: largest difference of kappa, degrees; `directions`:
    in how many of four quadrants photos are tilted by 5 degrees or more; `coverage`: share of the frame's cells.
    """

    tilt_median: float
    tilt_largest: float
    turned: float
    directions: int
    coverage: float


def geometry(result: BoardAdjustment, target: CalibrationTarget) -> PhotoGeometry:
    """The geometry of the photographs used."""
    R = result.state.rotation
    # The boards are the plane Z = 0, so that the tilt is the angle between the optical axis and Z.
    tilt = np.degrees(np.arccos(np.clip(np.abs(R[:, 2, 2]), 0.0, 1.0)))
    side = np.arctan2(R[:, 2, 1], R[:, 2, 0])[tilt >= _SIDEWAYS]
    kappa = np.array([angles(rotation)[2] for rotation in R])
    # Differences on the circle: -179 and 179 degrees are 2 degrees apart.
    apart = np.abs(np.angle(np.exp(1j * (kappa[:, None] - kappa[None]))))
    return PhotoGeometry(
        tilt_median=float(np.median(tilt)),
        tilt_largest=float(tilt.max()),
        turned=float(np.degrees(apart.max())),
        directions=len(np.unique(np.floor(side / (np.pi / 2)))),
        coverage=float(len(np.unique(frame_cells(result, target))) / CELLS**2),
    )


def frame_cells(result: BoardAdjustment, target: CalibrationTarget) -> np.ndarray:
    """Number of the cell of the frame for every corner used, row by row."""
    pixels = target.pixels(result.corners.xy[result.used])
    cell = np.clip((pixels / target.size * CELLS).astype(int), 0, CELLS - 1)
    return cell[:, 1] * CELLS + cell[:, 0]


def geometry_advice(result: BoardAdjustment, shape: PhotoGeometry) -> list[Advice]:
    """What the arrangement of the photographs determines poorly."""
    return [*_tilt_advice(shape), *_turn_advice(shape), *_correlation_advice(result)]


def _tilt_advice(shape: PhotoGeometry) -> list[Advice]:
    # One sentence: without tilt its directions are meaningless.
    if shape.tilt_largest < _TILTED:
        return [Advice(Weakness.NO_TILT, shape.tilt_largest)]
    if shape.tilt_median < _TILTED:
        return [Advice(Weakness.LITTLE_TILT, shape.tilt_median)]
    return [Advice(Weakness.ONE_SIDED_TILT, shape.directions)] if shape.directions < 3 else []


def _turn_advice(shape: PhotoGeometry) -> list[Advice]:
    turned = [Advice(Weakness.NOT_TURNED, shape.turned)] if shape.turned < _TURNED else []
    covered = [Advice(Weakness.LITTLE_COVERAGE, shape.coverage)] if shape.coverage < _COVERED else []
    return turned + covered


def _correlation_advice(result: BoardAdjustment) -> list[Advice]:
    table = correlations(result)
    # The pairs that tilting and turning the camera separates; others are correlated in any geometry, such as k1 with k2.
    pairs = [("c", "Z0"), ("x0", "phi"), ("y0", "omega"), ("x0", "omega"), ("y0", "phi"), ("x0", "X0"), ("y0", "Y0"), ("c", "phi")]
    found = {
        f"{row} and {column}": float(table.typical[table.rows.index(row), table.columns.index(column)])
        for row, column in pairs
        if row in table.rows
    }
    strong = {pair: value for pair, value in found.items() if value > _STRONG}
    return [Advice(Weakness.STRONG_CORRELATION, names=tuple(strong), values=tuple(strong.values()))] if strong else []


def result_advice(result: BoardAdjustment, check: HeldOut | None, target: CalibrationTarget) -> list[Advice]:
    """What residuals, halves and rejections show."""
    rejected = float(1.0 - result.used.mean())
    # The same angular error is more pixels in a larger frame: 1.5 px for one of 5000.
    scale = max(target.size) / 5000.0
    out = _check_advice(result, check)
    if rejected > _REJECTED:
        out.append(Advice(Weakness.MANY_REJECTED, rejected))
    if result.sigma0 > max(1.0, 1.5 * scale):
        out.append(Advice(Weakness.LARGE_SIGMA0, result.sigma0))
    return out + _parameter_advice(result) + _board_advice(result) + _bend_advice(result)


def _parameter_advice(result: BoardAdjustment) -> list[Advice]:
    """What the parameters themselves show."""
    value, sigma = result.state.interior, np.sqrt(np.maximum(np.diag(result.interior_covariance), 0.0))
    affinity, out = PARAMETERS.index("affinity"), []
    if sigma[0] > _UNCERTAIN * value[0]:
        out.append(Advice(Weakness.CONSTANT_UNCERTAIN, float(value[0]), values=(float(sigma[0]),)))
    if sigma[affinity] > 0 and abs(value[affinity]) > max(_SQUARE, _SURE * sigma[affinity]):
        out.append(Advice(Weakness.NOT_SQUARE, float(value[affinity]), values=(float(abs(value[affinity]) / sigma[affinity]),)))
    # Coefficients of large lenses take each other's place; one that is larger than 1 and not known at all is no lens.
    unknown = np.flatnonzero((sigma > 1.0) & (sigma > np.abs(value)) & (np.arange(len(value)) >= 3))
    if len(unknown):
        names = tuple(f"{PARAMETERS[k]} {value[k]:.3g} +- {sigma[k]:.2g}" for k in unknown)
        out.append(Advice(Weakness.UNDETERMINED, names=names))
    return out


def _check_advice(result: BoardAdjustment, check: HeldOut | None) -> list[Advice]:
    if check is None:
        return [Advice(Weakness.NOT_CHECKED)]
    # Formal precision includes neither the model's errors nor those common to all photographs; both show between the halves.
    parameter, ratio = check.worst
    worse = check.rms / result.rms if check.rms > _WORSE * result.rms else 0.0
    out = [Advice(Weakness.HELD_OUT_WORSE, worse)] if worse else []
    return [*out, Advice(Weakness.HALVES_DIFFER, ratio, (parameter,))] if ratio > _HALVES else out


def _board_advice(result: BoardAdjustment) -> list[Advice]:
    """Boards whose residuals are much larger than those of the others."""
    size = np.linalg.norm(result.residual, axis=1)
    # Medians, with rejected corners: of a warped board most may be rejected, and the rest would look fine.
    typical = [float(np.median(size[result.corners.board == board])) for board in range(result.network.boards)]
    middle = float(np.median(typical))
    # Of two boards neither is the odd one.
    bad = tuple(str(board + 1) for board, value in enumerate(typical) if len(typical) > 2 and value > _UNEVEN * middle)
    return [Advice(Weakness.UNEVEN_BOARDS, _UNEVEN, bad)] if bad else []


def _bend_advice(result: BoardAdjustment) -> list[Advice]:
    """The board that bends most, where that is remarkable: it was estimated, but a board that bends may do so differently in every
    photograph."""
    found = largest_bend(result)
    if found is None:
        return []
    board, bend, sigma = found
    if abs(bend) < _BENT * result.network.bend_sigma or abs(bend) < _CERTAIN * sigma:
        return []
    return [Advice(Weakness.BENT_BOARD, bend, (str(board + 1),), (sigma,))]


def search_advice(searches: tuple[PhotoSearch, ...]) -> list[Advice]:
    """Blurred and overexposed photographs, and boards with another number of corners."""
    # Blur without a measured edge is unknown, not zero.
    blurred = {search.photo: search.blur for search in searches if search.blur is not None and search.blur > _BLURRED}
    bright = {search.photo: search.overexposed for search in searches if search.overexposed > _OVEREXPOSED}
    larger = tuple(search.photo for search in searches if search.larger)
    other = Counter(size for search in searches for size in set(search.other))
    return [
        *([Advice(Weakness.BLURRED, names=tuple(blurred), values=tuple(blurred.values()))] if blurred else []),
        *([Advice(Weakness.OVEREXPOSED, names=tuple(bright), values=tuple(bright.values()))] if bright else []),
        *([Advice(Weakness.LARGER_BOARDS, names=larger)] if larger else []),
        # A single photograph may show a tiled floor; a board that was photographed on purpose is in several.
        *(Advice(Weakness.OTHER_BOARDS, times, corners=size) for size, times in other.items() if times > 1),
    ]
