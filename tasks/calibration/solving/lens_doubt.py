"""The doubt of the choice of a lens model: what other models that are as good would have given instead.

Standard errors of a least-squares adjustment hold if its model does. Where held-out photographs cannot tell models apart, the
camera is any of theirs: its covariance is the mean of their second moments about the chosen values, weighted by how well each keeps
up.
- A model of the same kind of lens tells all parameters, those too that the chosen one holds at zero: decentring that a few boards
  do not show moves the principal point, and a ray by less than either. What lenses are is known of such parameters beforehand.
- Lenses of other kinds share the camera constant and the principal point only. Where they know these less well than the chosen
  one they say less of them: the difference counts by the ratio of both standard errors (thin prisms know a principal point to 9 px
  where Brown knows it to 0.4).
With too few photographs to hold any out, all models of the chosen kind are as good.

Sources: Buckland, Burnham and Augustin 1997 (standard errors that include the selection of a model); Schmidt 1966 (parameters that
are held, and not known).
"""

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.adjustment.model.interior import NOMINAL_SIGMA, UNKNOWN_SIGMA
from orthomill.tasks.calibration.solving.lens_models import LensModel
from orthomill.tasks.calibration.solving.model_choice import Judged, as_good

_SHARED = ("c", "x0", "y0", "affinity")
"""Parameters that mean the same in lenses of every kind; coefficients are comparable within one kind."""
_HELD_SIGMA = {name: NOMINAL_SIGMA[name] or UNKNOWN_SIGMA[name] for name in ("k1", "k2", "k3", "p1", "p2")}
"""Standard errors of coefficients of lenses that nothing is known of. Pixels that a calibration found square are square."""


def doubted(judged: dict[LensModel, Judged], chosen: LensModel) -> BoardAdjustment:
    """The adjustment with the model `chosen`, with the doubt of this choice in the covariance of its interior parameters."""
    result = judged[chosen].result
    gains = as_good({model: one.check for model, one in judged.items()})
    gains = gains or {model: 0.0 for model in judged if model.lens == chosen.lens}
    weights = {model: float(np.exp(-0.5 * gain**2)) for model, gain in gains.items()}
    if set(weights) == {chosen}:
        return result
    told = [weight * _told(judged[model].result, model, result, chosen) for model, weight in weights.items()]
    return result.with_interior_covariance(np.sum(told, axis=0) / sum(weights.values()))


def _told(other: BoardAdjustment, model: LensModel, result: BoardAdjustment, chosen: LensModel) -> np.ndarray:
    """(17, 17): the second moment of the interior parameters about those of the `chosen` model, as another one tells it."""
    if model.lens == chosen.lens:
        value, covariance = _with_held(other, [name for name in model.free if name not in chosen.free])
        shift = value - result.state.interior
    else:
        covariance, shift = result.interior_covariance, _shared_shift(other, result, chosen, model)
    return covariance + np.outer(shift, shift)


def _with_held(other: BoardAdjustment, held: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Interior parameters (17,) and their covariance (17, 17), with what is known of the `held` ones: they are zero, within the
    standard errors of lenses."""
    value, covariance = other.state.interior, other.interior_covariance
    own = [PARAMETERS.index(name) for name in held]
    known = np.diag([_HELD_SIGMA.get(name, 0.0) ** 2 for name in held])
    gain = np.linalg.solve(covariance[np.ix_(own, own)] + known, covariance[own]).T
    told, left = value - gain @ value[own], covariance - gain @ covariance[own]
    # What is exactly zero keeps no rest of the rounding, which would be printed as a standard error.
    exact = [PARAMETERS.index(name) for name in held if name not in _HELD_SIGMA]
    told[exact] = left[exact] = left[:, exact] = 0.0
    return told, left


def _shared_shift(other: BoardAdjustment, result: BoardAdjustment, chosen: LensModel, model: LensModel) -> np.ndarray:
    """(17,): by how much the parameters that lenses of both kinds estimate differ, as far as the other one determines them."""
    both = [name in chosen.free and name in model.free and name in _SHARED for name in PARAMETERS]
    own, others = (np.diag(one.interior_covariance) for one in (result, other))
    known = np.sqrt(np.minimum(own / np.where(others > 0, others, np.inf), 1.0))
    return np.where(both, known * (other.state.interior - result.state.interior), 0.0)
