"""The corrections of several pairs in one cell become one, with a standard error and the number of pairs behind it.

Strategy. Every pair sees a place from two directions: what a house hides from one is open to another. Pairs that agree are averaged
by their precision. Where three or more disagree, the one farthest from the others is left out as long as it contradicts them; two
that contradict each other cannot be told apart: the cell keeps the more precise one, with the difference in its standard error, and
counts as disputed. Pairs share photographs and the texture of the ground, so that their errors are partly the same, and how much
follows from the directions of their bases: three pairs of three photographs are no three observations. What orientation and lens
leave in a pair (`precision/pair_bends.py`) is added to its standard error, where no number of nodes averages it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.job import Table
from orthomill.tasks.dsm_check.correction_map import CorrectionMap

EVERYWHERE = 0.02
"""correlation of two pairs without a common photograph: the surface and its texture are the same"""
_CONTRADICTS = 4.0
"""standard errors of a difference"""


class PairGeometry(NamedTuple):
    """The photographs of a pair, and the unit vector (2,) of its base from the left one to the right one, east and north."""

    left: str
    right: str
    direction: tuple[float, float]


ALONE = PairGeometry("", "", (0.0, 0.0))
"""a pair of which nothing is known"""


class PairBends(BaseModel):
    """Standard error (m) of the heights of every pair that its neighbours share, by the name of the pair."""

    model_config = ConfigDict(frozen=True)

    error: float = 0.0
    """orthoimage pixels: what explains the bends of all pairs"""
    of_pair: dict[str, float] = {}

    def of(self, names: Sequence[str]) -> np.ndarray:
        """(K,) m, of these pairs; 0 where nothing is known."""
        return np.array([self.of_pair.get(name, 0.0) for name in names])


BENDS = Table("dsm_check/bends.json", PairBends)
NO_BENDS = PairBends()


def shared_noise(pairs: Sequence[PairGeometry]) -> np.ndarray:
    """Correlations (K, K) of the corrections of pairs by what the noise of their photographs does.

    An error in a photograph that two pairs share moves the detail in both; what it has along the base counts, so that pairs in the
    same direction from that photograph err alike, those at right angles do not, and those in opposite directions the other way.
    """
    found = np.eye(len(pairs))
    for k, one in enumerate(pairs):
        for m, other in enumerate(pairs[:k]):
            meets = 0.0
            for own, sign in ((one.left, 1.0), (one.right, -1.0)):
                for its, turn in ((other.left, 1.0), (other.right, -1.0)):
                    meets += sign * turn * float(np.dot(one.direction, other.direction)) * (own == its) / 2.0
            found[k, m] = found[m, k] = EVERYWHERE + (1.0 - EVERYWHERE) * meets
    return found


def joint(
    maps: list[CorrectionMap], shape: tuple[int, int], correlation: np.ndarray | None = None, bends: np.ndarray | None = None
) -> tuple[CorrectionMap, np.ndarray]:
    """The corrections of all pairs together, and disputed cells (rows, cols) bool.

    correlation: (K, K) of the noise of the maps; None where they have nothing in common. bends: (K,) m, standard errors that the
    cells of a map share.
    """
    disputed = np.zeros(shape, np.bool_)
    if not maps:
        return CorrectionMap(np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)), disputed
    bent = np.zeros(len(maps)) if bends is None else bends
    if len(maps) == 1:
        return CorrectionMap(maps[0].dh, np.hypot(maps[0].sigma, np.float32(bent[0]))), disputed
    dh, sigma = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    common = np.eye(len(maps)) if correlation is None else correlation
    _join(np.stack([m.dh for m in maps]), np.stack([m.sigma for m in maps]), bent, common, dh, sigma, disputed)
    return CorrectionMap(dh, sigma), disputed


@njit()
def _join(all_dh, all_sigma, bends, common, dh, sigma, disputed):
    """Join the corrections of all pairs, `all_dh` and `all_sigma` (k, r, c) m, to `dh` and `sigma` (r, c): means by weight, without
    pairs that contradict the others, `disputed` where two are left that contradict each other. bends (k,): m, standard errors
    that the cells of a map share; common (k, k): correlation of the noise of the maps."""
    values, errors = np.empty(all_dh.shape[0]), np.empty(all_dh.shape[0])
    which = np.empty(all_dh.shape[0], np.int64)
    for r in range(dh.shape[0]):
        for c in range(dh.shape[1]):
            n = 0
            for k in range(all_dh.shape[0]):
                if np.isfinite(all_dh[k, r, c]):
                    values[n], which[n] = all_dh[k, r, c], k
                    errors[n] = np.sqrt(all_sigma[k, r, c] ** 2 + bends[k] ** 2)
                    n += 1
            if n == 0:
                continue
            given = n
            while n >= 3:
                worst, by = 0, 0.0
                for k in range(n):
                    # Against the mean of the others: an error in the mean itself would hide the pair that makes it.
                    total, weight = 0.0, 0.0
                    for m in range(n):
                        if m != k:
                            total += values[m] / errors[m] ** 2
                            weight += 1.0 / errors[m] ** 2
                    away = abs(values[k] - total / weight) / np.sqrt(errors[k] ** 2 + 1.0 / weight)
                    if away > by:
                        worst, by = k, away
                if by <= _CONTRADICTS:
                    break
                n -= 1
                values[worst], errors[worst], which[worst] = values[n], errors[n], which[n]
            total, weight, best = 0.0, 0.0, 0
            for k in range(n):
                total += values[k] / errors[k] ** 2
                weight += 1.0 / errors[k] ** 2
                if errors[k] < errors[best]:
                    best = k
            mean, chi, together = total / weight, 0.0, 0.0
            for k in range(n):
                chi += (values[k] - mean) ** 2 / errors[k] ** 2
                for m in range(n):
                    # Bends of pairs in a row do not correct each other: they are more than the noise of the common photograph.
                    alike = common[which[k], which[m]]
                    noise = alike * all_sigma[which[k], r, c] * all_sigma[which[m], r, c]
                    bent = max(alike, 0.0) * bends[which[k]] * bends[which[m]]
                    together += (noise + bent) / (errors[k] * errors[m]) ** 2
            # Never worse than the best of them alone.
            variance = min(together / weight**2, errors[best] ** 2)
            if n == 2 and abs(values[0] - values[1]) > _CONTRADICTS * np.sqrt(errors[0] ** 2 + errors[1] ** 2):
                disputed[r, c] = given == 2
                dh[r, c] = values[best]
                sigma[r, c] = np.sqrt(errors[best] ** 2 + (values[0] - values[1]) ** 2)
                continue
            dh[r, c] = mean
            sigma[r, c] = np.sqrt(variance * max(1.0, chi / max(n - 1, 1)))
