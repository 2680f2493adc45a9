"""The place of a point in an orthoimage from those that its photographs find there, one each.

Every photograph that shows a point is one witness. Beside a wall the patches of some show the wall or what it hides, and are found
where the orthoimage has something like it, each elsewhere: what more than half of the witnesses say is taken, and nothing else, for
a minority may be chance however small its own standard errors are.
"""

import numpy as np

from orthomill.schemas.accuracy.point_tests import TESTED, PlaceTest

_DISAGREE = 4.0
"""standard errors of their difference beyond which two places are not the same"""


def agreed_place(places: np.ndarray, variances: np.ndarray, witnesses: int) -> PlaceTest:
    """The weighted mean of the places (N, 2) m, variances (N, 2) m2, that agree with one of them; N of `witnesses` photographs
    found any. Not tested where these are no more than half of the witnesses."""
    apart = np.abs(places[:, None] - places[None])
    same = (apart <= _DISAGREE * np.sqrt(variances[:, None] + variances[None])).all(axis=2)
    keep = same[np.argmax(same.sum(axis=1))]
    count = int(keep.sum())
    if 2 * count <= witnesses:
        return PlaceTest(reason=f"no more than {count} of {witnesses} photographs find it at one place in the orthoimage")
    x, y, sx, sy = map(float, _mean(places[keep], variances[keep]))
    return PlaceTest(reason=TESTED, place=(x, y), sigma=(sx, sy), photos=count)


def _mean(places: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """X, Y and their standard errors, m."""
    weight = 1 / variances
    mean, variance = (places * weight).sum(axis=0) / weight.sum(axis=0), 1 / weight.sum(axis=0)
    if len(places) > 1:
        # What the patches say of themselves, where they say more than their stated errors do.
        variance *= np.maximum(((places - mean) ** 2 * weight).sum(axis=0) / (len(places) - 1), 1.0)
    return np.concatenate([mean, np.sqrt(variance)])
