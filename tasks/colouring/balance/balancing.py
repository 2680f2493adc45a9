"""The radiometry of a block from its samples, by the way that the workflow chose."""

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.tasks.colouring.balance.histogram_matching import matched_block
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.balance.radiometric_balance import balance_block
from orthomill.tasks.colouring.balance.shared_ground import Samples

# 16 bits are stretched so that the brightest thousandth of the samples keeps a margin below white: specular points may saturate.
_BRIGHTEST, _BRIGHT_MARGIN = 0.999, 1.05


def balanced(samples: tuple[Samples, ...], names: tuple[str, ...], deep: bool, method: str, vignetting: bool) -> Radiometry:
    """The radiometry of the photographs `names` from the samples of all tiles.

    `deep`: the photos have 16 bits; 0 to 255 then corresponds to 0 to a little above the brightest thousandth of the samples.
    `method` "histogram" makes their histograms alike, "none" leaves the photos' grey values as stored (the stretch remains).
    """
    merged = Samples(**{name: np.concatenate([getattr(part, name) for part in samples]) for name in Samples.__dataclass_fields__})
    white = 255.0
    if deep:
        white = float(min(_BRIGHT_MARGIN * np.quantile(merged.grey, _BRIGHTEST), 65535.0)) if len(merged) else 65535.0
    # Without any sample the balance is the identity, with the right range.
    if method == "histogram":
        return matched_block(names, merged, white)
    if method == "none":
        return balance_block(names, merged.take(np.zeros(len(merged), bool)), white, vignetting)
    return balance_block(names, merged, white, vignetting)


def balanced_block(samples: tuple[Samples, ...], block: Block, deep: bool, method: str, vignetting: bool) -> Radiometry:
    """The radiometry of the photographs of a block from the samples of all tiles: see `balanced`."""
    return balanced(samples, block.names, deep, method, vignetting)
