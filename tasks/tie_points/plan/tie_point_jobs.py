"""Features per tile, matches per pair, tracks over all, patches per strip, refinement per pair.

    photo levels -> features of tiles -> features of photographs -> matches of pairs -> tracks
                                                                                          |
    photo strips -------------------------------------> patches of observations <---------+
                                                           |
                            tie points and report  <- refined pairs of every photograph

Only the feature jobs and the patch jobs read pixels, a part or a strip at a time; all other jobs work on points and patches. (With
`search: correlation` the pairs read the searched level too.)
"""

from collections.abc import Iterator

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Export, Job
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import ProjectView
from orthomill.tasks.tie_points.pair_selection import Neighbourhood, candidate_pairs, needs_appearance
from orthomill.tasks.tie_points.plan.feature_jobs import appearance_jobs, feature_jobs
from orthomill.tasks.tie_points.plan.match_jobs import count_job, pair_job, track_job
from orthomill.tasks.tie_points.plan.refinement_jobs import last_job, patch_jobs, refinement_jobs
from orthomill.tasks.tie_points.plan.tie_point_tables import CANDIDATES, LINKS, MATCH_COUNTS
from orthomill.tasks.tie_points.stage import TiePointsStage


def tie_point_jobs(asked: TiePointsStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """Everything up to the tracks at once; patches and refinement when the tracks show which photographs are linked."""
    photos, tile = view.table(PHOTOS), view.project.tile
    if len(photos.photos) < 2:
        raise GeometryError(
            f"The project has a single photograph ({photos.names[0]}); surfaces are measured from two or more that "
            "overlap, so add more."
        )
    for photo in photos.photos:
        yield from feature_jobs(asked, photo)
    neighbourhood = Neighbourhood(asked.all_pairs_up_to, asked.nearest)
    if needs_appearance(photos, neighbourhood):
        yield from appearance_jobs(asked, photos, neighbourhood)
        pairs = view.table(CANDIDATES).pairs
    else:
        pairs = candidate_pairs(photos, neighbourhood)
    yield from (pair_job(asked, photos.photos[left], photos.photos[right]) for left, right in pairs)
    yield count_job(asked, photos, pairs)
    yield track_job(asked, photos, pairs, view.table(MATCH_COUNTS))
    links = view.table(LINKS)
    for photo in photos.photos:
        yield from patch_jobs(asked, photo, tile)
    yield from refinement_jobs(asked, photos, links, tile)
    yield last_job(asked, photos, pairs, links)
