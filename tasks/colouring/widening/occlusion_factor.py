"""What the colour of a photograph is worth next to what it does not see of a height model: the widening on the ground.

Source: Petsa et al. 2007 (sources/blending.md, M10), on the ground instead of in the photograph.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.visibility.height_model import widening_factor
from orthomill.tasks.visibility.sight import PlaceSight

RESERVED_FACTOR = 1e-3
"""Weight factor next to an occlusion: such a colour is used only where no photo has a better one."""
LAST_FACTOR = 1e-6
"""Weight factor behind what may not be there: such a colour is used only where that stands in front of every photo."""
_FACTORS = np.array(
    [LAST_FACTOR if code == PlaceSight.BEHIND_ESTIMATE else float(code >= PlaceSight.AT_BREAK) for code in PlaceSight], np.float32
)


def occlusion_factor(sight: np.ndarray, margin: float, ramp: float) -> np.ndarray:
    """Weight factors (rows, cols) float32 of a photo from its codes of PlaceSight: 0 where it does not see the pixel, small behind
    an estimate and within `margin` px of an occlusion, from there rising to 1 over `ramp` px."""
    if margin + ramp <= 0:
        return np.asarray(_FACTORS[sight])
    # A hole without height is no occlusion: its rim is as well visible as any other ground.
    occluded = (sight == PlaceSight.HIDDEN) | (sight == PlaceSight.BEHIND_ESTIMATE)
    widened = widening_factor(occluded, margin, ramp)
    _weigh(sight, _FACTORS, widened)
    return widened


@njit()
def _weigh(sight, factors, factor):
    """Turns factors (rows, cols) that fall towards occlusions into those of what is seen; of the rest the factor of its code."""
    least = np.float32(RESERVED_FACTOR)
    for i in range(sight.shape[0]):
        for j in range(sight.shape[1]):
            code = sight[i, j]
            factor[i, j] = max(factor[i, j], least) if code >= PlaceSight.AT_BREAK else factors[code]
