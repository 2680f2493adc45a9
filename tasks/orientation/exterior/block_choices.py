"""What a workflow decides of the block adjustment, and what follows from the photographs where it decides nothing."""

import numpy as np

from orthomill.schemas.photo import Photos
from orthomill.schemas.settings import Settings
from orthomill.tasks.adjustment.model.interior_settings import InteriorChoice, NoVariation, VariationChoice
from orthomill.tasks.orientation.orientation_settings import Looking, ShiftChoice
from orthomill.tasks.orientation.start.georeference import Known

LEVER_SIGMA = 0.05
"""m: by which positions that a receiver has reduced to the camera still miss it: several lenses in one housing, a time between
trigger and exposure. Positions that are less precise do not show it."""

VERTICAL_DEG = {"gimbal": 1.0, "aircraft": 3.0}
"""Standard errors of the mean vertical that attitudes give: a gimbal holds it to some tenths of a degree, and its camera is
mounted to half a degree; an aircraft leans, and its camera with it."""
ASSUMED_DEG = 5.0
"""The same for attitudes of unknown origin, and for the assumption that photographs look straight down on average."""


class BlockChoices(Settings):
    """What the workflow decides: the part of the interior orientation, a common shift of the GNSS positions, the standard error
    of the mean vertical where it is needed (degrees; None: that of what tells it) and how the photographs look then, the limit of
    the blunder test in standard errors, the lever arm of the antenna (m, image system) with its standard error (0: exactly known;
    None: as receivers leave it), and what of the interior orientation varies from photograph to photograph."""

    interior: InteriorChoice
    gnss_shift: ShiftChoice
    vertical_sigma: float | None
    rejection: float
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_sigma: float | None = None
    looking: Looking = "auto"
    variation: VariationChoice = NoVariation(kind="none")


def vertical_sigma(choices: BlockChoices, photos: Photos) -> float:
    """rad: of the mean vertical, as stated, or that of the worst of the attitudes that take part."""
    if choices.vertical_sigma is not None:
        return float(np.radians(choices.vertical_sigma))
    told = {photo.attitude_of for photo in photos.photos if photo.attitude is not None}
    return float(np.radians(max((VERTICAL_DEG.get(of or "", ASSUMED_DEG) for of in told), default=ASSUMED_DEG)))


def lever_sigma(choices: BlockChoices, known: Known) -> float:
    """m: as stated; else that of receivers whose positions show it, and 0 where their own errors hide it."""
    if choices.lever_sigma is not None:
        return choices.lever_sigma
    plan = known.position_sigma[known.positioned, :2]
    return LEVER_SIGMA if len(plan) and np.median(plan) < LEVER_SIGMA else 0.0
