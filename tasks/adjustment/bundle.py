"""Bundle adjustment: collinearity for every ray, all orientations, points and (if asked for) cameras together.

Strategy of `adjust`. (1) A robust solution (Huber); gross blunders are removed: whole positions and surveyed points first, then
rays. (2) Plain least squares, after which positions and surveyed points are tested, the worst one removed alone; then the standard
errors of the groups of observations are estimated from the residuals and their actual redundancy (variance components), and every
ray is tested by its own standardised residual (data snooping, the worst ray of a point at a time), until nothing changes. (3)
Surveyed observations that agree with this solution although they were rejected are reinstated, once. (4) The covariance of all
orientations and cameras is the inverse of the reduced normal matrix; that of the points follows from it.

What a person measured or surveyed (positions, control and its image measurements) keeps its stated standard errors unless it
contradicts them; then these are enlarged. It is a group of its own, because a matched tie point is often ten times as precise as a
pointing, and a common factor would reject good control.

Source: Brown 1976; Baarda 1968 for the tests; Triggs et al. 2000.
"""

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.adjustment_steps import (
    final_result,
    plain_solution,
    reweighted,
    settled,
    with_reinstated_blunders,
    with_variance_components,
    without_ray_blunders,
    without_surveyed_blunder,
)
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.progress import BlunderTest
from orthomill.tasks.adjustment.robust_solution import robust_solution
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment


def adjust(network: Network, start: State, rays: Rays, test: BlunderTest | None = None) -> Adjustment:
    """The adjusted block with tested observations and its covariance.

    Raises GeometryError when the block falls apart (too few rays), is not determined, or does not converge.
    """
    test = test or BlunderTest()
    now = robust_solution(network, start, rays, test)
    while now.rounds < test.rounds:
        now = without_surveyed_blunder(plain_solution(now))
        # A blunder among the surveyed observations distorts the rays around it: they are tested only without it.
        if now.changed:
            continue
        now = without_ray_blunders(with_variance_components(now))
        if now.changed:
            # New weights move the solution, and with it the residuals that were just tested.
            now = reweighted(now)
            continue
        now = with_reinstated_blunders(now)
        if not now.changed:
            return final_result(settled(now))
    if (now.used == now.solution.used).all():
        # Standard errors of a few surveyed points creep where they nearly balance positions; they are known to a third only.
        return final_result(now)
    raise GeometryError(
        f"The blunder tests of the bundle adjustment still rejected rays in the last of {test.rounds} rounds; the tie points "
        "contain too many wrong matches."
    )
