"""The settings by which two orthoimages are compared."""

import numpy as np

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.gaussian_reach import reach_of
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching


class ShiftSearch(Settings):
    """The search for homologous points of two orthoimages."""

    reach: int = setting(10, "Greatest shift along the base that is searched.", "orthoimage pixels", ge=2, le=40)
    window: int = setting(13, "Side of the correlation window on orthoimages of half the size.", "px", ge=5, le=31)
    gain: float = setting(0.05, "How much better than no shift another shift must correlate.", ge=0, le=1)
    across: float = setting(2.0, "Greatest shift across the base; larger ones are wrong matches.", "orthoimage pixels", gt=0)
    back: float = setting(1.5, "Greatest distance from the point at which the reverse search may end.", "orthoimage pixels", gt=0)


class NodeMatching(Settings):
    """How the orthoimages are matched."""

    search: ShiftSearch = setting(ShiftSearch(), "The search for start values.")
    least_squares: LeastSquaresMatching = setting(
        LeastSquaresMatching(window=11, max_shift=3.0, min_correlation=0.7), "Least-squares matching from these start values."
    )
    least_sigma: float = setting(
        0.03,
        "Error of a shift that the matching does not report: orthoimages are resampled, so that their noise is correlated.",
        "orthoimage pixels",
        gt=0,
    )
    hidden: float = setting(1.5, "A node is hidden when the model rises above its ray by more than this.", "cells", gt=0)

    @property
    def halo(self) -> int:
        """Pixels around a tile of orthoimage that its nodes need; even, so that pixels of half size keep their places."""
        # 1.5: the window may grow and shear during the iterations before its corners leave the image
        lsm = self.least_squares
        window = int(np.ceil(lsm.reach * 1.5 + lsm.max_shift)) + reach_of(lsm.smoothing) + 3
        correlation = 2 * (self.search.window // 2) + 4
        return 2 * int(np.ceil((2 * self.search.reach + 4 + max(window, correlation)) / 2))
