"""The doubt of the choice of a lens model: what other models that are as good would have given instead.

Standard errors of a least-squares adjustment hold if its model does. Where held-out photographs cannot tell models apart, the
parameters that the others would have given are as likely as those of the chosen one: their differences, weighted by how well each
model keeps up, are added to the covariance. A model that determines a parameter less well than the chosen one says less of it: its
difference counts by the ratio of both standard errors (thin prisms know a principal point to 9 px where Brown knows it to 0.4).

Source: Buckland, Burnham and Augustin 1997 (standard errors that include the selection of a model).
"""

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.calibration.solving.lens_models import LensModel
from orthomill.tasks.calibration.solving.model_choice import Judged, as_good

_SHARED = ("c", "x0", "y0", "affinity")
"""Parameters that mean the same in lenses of every kind; coefficients are comparable within one kind."""


def doubted(judged: dict[LensModel, Judged], chosen: LensModel) -> BoardAdjustment:
    """The adjustment with the model `chosen`, with the doubt of this choice in its covariance."""
    gains = as_good({model: one.check for model, one in judged.items()})
    result, doubt = judged[chosen].result, np.zeros((len(PARAMETERS), len(PARAMETERS)))
    weights = {model: float(np.exp(-0.5 * gain**2)) for model, gain in gains.items()}
    for model, weight in weights.items():
        shift = _shift(judged[model].result, result, chosen, model)
        doubt += weight / sum(weights.values()) * np.outer(shift, shift)
    return result.with_doubt(doubt)


def _shift(other: BoardAdjustment, result: BoardAdjustment, chosen: LensModel, model: LensModel) -> np.ndarray:
    """(17,): by how much the parameters that both models estimate differ, as far as the other one determines them."""
    alike = chosen.lens == model.lens
    both = [name in chosen.free and name in model.free and (alike or name in _SHARED) for name in PARAMETERS]
    own, others = (np.diag(one.interior_covariance) for one in (result, other))
    known = np.sqrt(np.minimum(own / np.where(others > 0, others, np.inf), 1.0))
    return np.where(both, known * (other.state.interior - result.state.interior), 0.0)
