"""How good the position of a photograph is, by its tags: the kind of fix decides, the standard errors beside it refine.

The same tags hold the standard errors of a position by carrier phases (centimetres) and of one without (metres), and the filters of
receivers state less than their errors wherever these are common to a whole flight: a position by code alone is never taken for
better than a receiver of that kind is.

Sources: DJI, Zenmuse P1 and Mavic 3 Enterprise manuals (RtkFlag 0: no position, 16: single point, 34: float, 50: fixed); Pix4D's
XMP fields (GPSXYAccuracy, GPSZAccuracy); EXIF 2.31 (GPSHPositioningError).
"""

from collections.abc import Mapping

from orthomill.schemas.photo import Fix
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.makers import maker_number

Sigma = tuple[float, float, float]

BY_CODE: Sigma = (3.0, 3.0, 5.0)
"""m: standard errors of a receiver without corrections, and of a position of which nothing is said"""
_BY_FLOAT: Sigma = (0.3, 0.3, 0.5)
_BY_PHASE: Sigma = (0.03, 0.03, 0.05)
"""m: of a fixed solution that does not state its own"""
_BEST: Sigma = (0.01, 0.01, 0.015)
"""m: no antenna above a moving camera does better, whatever its tags say"""
_WORST = 100.0
"""m: larger standard errors are those of a receiver that knows nothing"""
_FIXED, _FLOAT = 50, 32


def fix_of(tags: Mapping[str, str]) -> Fix | None:
    """How the position was found; None where the tags do not say."""
    flag = maker_number(tags, "RtkFlag")
    if flag is None or not 0 <= flag < 100:
        return None
    if flag >= _FIXED:
        return "fixed"
    return "float" if flag >= _FLOAT else "single" if flag >= 1 else "none"


def position_sigma(tags: Mapping[str, str]) -> Sigma:
    """Standard errors in X, Y and Z, m, of the position that the tags hold."""
    stated, fix = _stated(tags), fix_of(tags)
    if fix == "fixed":
        return _no_better(stated or _BY_PHASE, _BEST)
    if fix == "float":
        return _no_better(stated or _BY_FLOAT, _BY_FLOAT)
    # A standard error of a filter means nothing without the kind of its fix; an accuracy was written to be used.
    accuracy = None if fix else _accuracy(tags)
    return _no_better(accuracy, _BEST) if accuracy else _no_better(stated or BY_CODE, BY_CODE)


def _stated(tags: Mapping[str, str]) -> Sigma | None:
    """The standard errors of the receiver's filter."""
    return _possible(*(maker_number(tags, name) for name in ("RtkStdLon", "RtkStdLat", "RtkStdHgt")))


def _accuracy(tags: Mapping[str, str]) -> Sigma | None:
    """What programs and receivers state for the user; the height of a phone is worse than its plan in the usual proportion."""
    plan, height = maker_number(tags, "GPSXYAccuracy"), maker_number(tags, "GPSZAccuracy")
    if plan is None:
        plan = exif.positive(tags, "GPSHPositioningError")
        return _possible(plan, plan, None if plan is None else max(BY_CODE[2], plan * BY_CODE[2] / BY_CODE[0]))
    return _possible(plan, plan, plan * BY_CODE[2] / BY_CODE[0] if height is None else height)


def _possible(x: float | None, y: float | None, z: float | None) -> Sigma | None:
    if x is None or y is None or z is None or not all(0 < value < _WORST for value in (x, y, z)):
        return None
    return x, y, z


def _no_better(sigma: Sigma, least: Sigma) -> Sigma:
    x, y, z = (max(own, best) for own, best in zip(sigma, least, strict=True))
    return x, y, z
