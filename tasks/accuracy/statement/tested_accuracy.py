"""RMSE, class and wording of ASPRS edition 2 from products tested at points, and how sure so few points make them.

The survey of the points has errors of its own, which edition 2 adds by root of sum of squares: RMSE^2 = fit^2 + survey^2. The
interval follows from the distribution of the mean square of n differences; where plan differences have two directions they count
for more than n, by the ratio of their variances.

Source: ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (2023), 7.4 to 7.12 (formulas, numbers of check
points, reporting).
"""

import math

import numpy as np
from scipy.special import gammaincinv

from orthomill.schemas.accuracy.accuracy_statement import HEIGHTS, AccuracyFigure, AccuracyKind, class_of

LEAST, MOST = 30, 120
"""check points of a formal statement: at least so many, and no more for any area"""
CONFIDENCE = 0.95
_STANDARD = "ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2"
_NVA = "The Non-Vegetated Vertical Accuracy (NVA) was found to be RMSE_V"
_VVA = "The Vegetated Vertical Accuracy (VVA) was found to be RMSE_V"
_CLASSES: dict[AccuracyKind, str] = {
    "horizontal": "RMSE_H Horizontal Positional Accuracy Class",
    **dict.fromkeys(HEIGHTS, "RMSE_V Vertical Accuracy Class"),
    "three_dimensional": "RMSE_3D Three-Dimensional Positional Accuracy Class",
}
_FOUND: dict[AccuracyKind, str] = {
    "horizontal": "The tested horizontal positional accuracy was found to be RMSE_H",
    "nva": _NVA,
    "vva": _VVA,
    "nva_terrain": _NVA,
    "vva_terrain": _VVA,
    "three_dimensional": "The tested three-dimensional accuracy was found to be RMSE_3D",
}


def points_needed(area_km2: float) -> int:
    """Check points of a formal statement about an area: 30 up to 1000 km2, 10 more for every further 1000 km2, 120 at most."""
    return min(MOST, LEAST + 10 * max(0, math.ceil(area_km2 / 1000) - 1))


def accuracy_of(
    kind: AccuracyKind,
    difference: np.ndarray,
    survey: np.ndarray,
    promised: np.ndarray | None,
    area_km2: float,
    surface: tuple[float, float] | None = None,
) -> AccuracyFigure | None:
    """The accuracy of one kind; None without points.

    difference, survey: (N, k) m, product minus survey and standard errors of the survey, k coordinates of this kind; promised:
    standard errors of the differences that were promised, of the same shape, or None; surface: root mean squares (m) of what the
    surface promises at these points and wherever points could test it, or None.
    """
    if not len(difference):
        return None
    squares = (difference**2).sum(axis=1)
    fit, known = float(np.sqrt(squares.mean())), float(np.sqrt((survey**2).sum(axis=1).mean()))
    rmse = math.hypot(fit, known)
    low, high = (math.hypot(bound, known) for bound in carried_over(interval(difference), surface))
    needed, lengths = points_needed(area_km2), np.sqrt(squares)
    height = kind in HEIGHTS
    middle = np.median(difference[:, 0])
    ratio = None if promised is None else float(np.sqrt(((difference / np.maximum(promised, 1e-9)) ** 2).mean()))
    return AccuracyFigure(
        kind=kind,
        points=len(difference),
        needed=needed,
        fit=fit,
        survey=known,
        rmse=rmse,
        low=low,
        high=high if math.isfinite(high) else None,
        mean=float(difference[:, 0].mean()) if height else float(np.linalg.norm(difference.mean(axis=0))),
        robust=float(1.4826 * np.median(np.abs(difference[:, 0] - middle))) if height else None,
        at_68=float(np.quantile(lengths, 0.6827, method="higher")),
        at_90=float(np.quantile(lengths, 0.9, method="higher")),
        at_95=float(np.quantile(lengths, 0.95, method="higher")),
        promised=ratio,
        promised_here=surface and surface[0],
        promised_everywhere=surface and surface[1],
        class_cm=class_of(rmse),
        proved_cm=class_of(high) if math.isfinite(high) else None,
        sentence=wording(kind, rmse, len(difference), needed),
    )


def interval(difference: np.ndarray, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Confidence interval of the root mean square length of (N, k) differences, m; from 0 to infinity for a single one.

    The sum of squares of n vectors of normal errors is about a multiple of chi-square with n (sum l)^2 / sum l^2 degrees of
    freedom, l the mean squares along their principal axes (Welch, Satterthwaite). Errors with a few large ones among them are more
    uncertain than that: their own fourth moments widen it.
    """
    squares = (difference**2).sum(axis=1)
    n, mean = len(difference), float(squares.mean())
    if n < 2 or mean == 0:
        return (0.0, math.inf) if mean else (0.0, 0.0)
    axes = np.linalg.eigvalsh(difference.T @ difference / n)
    freedom = n * float(axes.sum() ** 2 / (axes**2).sum())
    own = float(squares.var(ddof=1))
    if own > 0:
        freedom = min(freedom, 2 * n * mean**2 / own)
    freedom, tail = max(freedom, 1.0), (1 - confidence) / 2
    low, high = (float(2 * gammaincinv(freedom / 2, p)) for p in (1 - tail, tail))
    return math.sqrt(mean * freedom / low), math.sqrt(mean * freedom / high)


def carried_over(bounds: tuple[float, float], surface: tuple[float, float] | None) -> tuple[float, float]:
    """An interval (m) of what points found, widened to one of the whole surface, by the difference of the mean squares that it
    promises at the points and everywhere.

    A few places of large promised errors hold much of a surface's mean square, and few points meet one of them: the errors of such
    surfaces are far from normal, while in units of what was promised they are not.
    """
    if surface is None:
        return bounds
    here, everywhere = surface
    low, high = bounds
    more = everywhere**2 - here**2
    return math.sqrt(max(low**2 + min(more, 0.0), 0.0)), math.sqrt(high**2 + max(more, 0.0))


def wording(kind: AccuracyKind, rmse: float, points: int, needed: int) -> str:
    """The sentence that the standard prescribes, with the values; another one where there are fewer points than it calls for."""
    class_, found = class_of(rmse), f"{_FOUND[kind]} = {100 * rmse:.1f} cm"
    if points >= needed:
        return f"This data set was tested to meet {_STANDARD} for {_article(class_)} {class_}-cm {_CLASSES[kind]}. {found}."
    called = "thirty (30)" if needed == LEAST else str(needed)
    return (
        f"This data set was tested as required by {_STANDARD}. Although the Standards call for a minimum of {called} checkpoints, "
        f"this test was performed using ONLY {points} checkpoint{'' if points == 1 else 's'}. This data set was produced to meet "
        f"{_article(class_)} {class_}-cm {_CLASSES[kind]}. {found} using the reduced number of checkpoints."
    )


_DECLARED: dict[AccuracyKind, str] = {
    "horizontal": _CLASSES["horizontal"],
    **dict.fromkeys(("nva", "nva_terrain"), "RMSE_V Non-Vegetated Vertical Accuracy (NVA) Class"),
    **dict.fromkeys(("vva", "vva_terrain"), "RMSE_V Vegetated Vertical Accuracy (VVA) Class"),
}


def declared(kind: AccuracyKind, limit: float) -> str:
    """What the standard lets a producer say of a class (m) without any test; it has no such sentence for three dimensions."""
    centimetres = f"{round(100 * limit, 2):g}"
    return f"This data set was produced to meet {_STANDARD} for {_article(centimetres)} {centimetres}-cm {_DECLARED[kind]}."


def _article(class_: int | str) -> str:
    """Eight, eleven, eighteen and eighty begin with a vowel."""
    return "an" if str(class_).startswith("8") or str(class_).partition(".")[0] in ("11", "18") else "a"
