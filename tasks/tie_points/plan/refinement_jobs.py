"""Patches of observations, strip by strip; the refinement of the pairs of every photograph; the tie points."""

from collections.abc import Iterator
from itertools import groupby

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.job import Job, Raster, Stream
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.observations import TIE_POINT_COUNTS, TIE_POINTS
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.tie_points.match_records import Links
from orthomill.tasks.tie_points.patches import Strip, strip_patches
from orthomill.tasks.tie_points.plan.tie_point_tables import (
    LINKS,
    level_size,
    observation_table,
    overview,
    pair_tables,
    patch_level,
    patch_table,
    refined_tables,
    search_level,
)
from orthomill.tasks.tie_points.refinement import PatchRules, Refinable, refine_pairs
from orthomill.tasks.tie_points.report.tie_point_report import finish
from orthomill.tasks.tie_points.stage import TiePointsStage
from orthomill.tasks.tie_points.tie_point_assembly import Weighting


def patch_jobs(asked: TiePointsStage, photo: Photo, tile: int) -> Iterator[Job]:
    """The jobs that cut the grey values around the observations of a photograph, by strips."""
    for number, strip in enumerate(_strips(asked, photo, tile)):
        yield Job(
            stage=asked.kind,
            item=f"{photo.name} patches",
            row=number,
            function=strip_patches,
            reads={
                "pixels": Raster(photo_raster(photo.name, strip.level), strip.window),
                "overview": overview(photo),
                "observations": observation_table(photo.name),
            },
            writes={"patches": patch_table(photo.name, number)},
            params={"strip": strip},
            # Patches, the grey values of the strip and, of some rows at a time, the numbers that these are made of.
            scratch=array_bytes(1, (2 * strip.half + 1) ** 2, asked.max_features) + array_bytes(3, strip.window),
        )


def refinement_jobs(asked: TiePointsStage, photos: Photos, links: Links, tile: int) -> Iterator[Job]:
    """One for each photograph that is the first of pairs."""
    for left, pairs in groupby(links.pairs, key=lambda pair: pair[0]):
        partners = tuple(_refinable(asked, photos, right, tile) for _, right in pairs)
        yield _refinement_job(asked, _refinable(asked, photos, left, tile), partners)


def last_job(asked: TiePointsStage, photos: Photos, pairs: tuple[tuple[int, int], ...], links: Links) -> Job:
    """The job that makes the list of tie points and the report of what all others found."""
    names = photos.names
    # The setting counts pixels of the searched level; with several cameras the coarsest one is the cautious choice.
    coarsest = 2 ** max(search_level(asked, photo) for photo in photos.photos)
    return Job(
        stage=asked.kind,
        item="tie points",
        function=finish,
        reads={
            "photos": PHOTOS,
            "links": LINKS,
            "summaries": tuple(pair_tables(names[left], names[right])[1] for left, right in pairs),
            "observations": tuple(observation_table(name) for name in names),
            "refined": tuple(refined_tables(names[left])[0] for left in links.first),
            "scatters": tuple(refined_tables(names[left])[1] for left in links.first),
        },
        writes={"tie_points": TIE_POINTS, "counts": TIE_POINT_COUNTS, "report": report_table(asked.kind)},
        params={"weighting": Weighting(asked.sigma_floor, asked.sigma_unrefined * coarsest, asked.unrefined)},
        scratch=array_bytes(700, links.tracks),
    )


def _rules(asked: TiePointsStage, photo: Photo, tile: int) -> PatchRules:
    return PatchRules(patch_level(asked, photo), tile, asked.refinement)


def _strips(asked: TiePointsStage, photo: Photo, tile: int) -> list[Strip]:
    rules = _rules(asked, photo, tile)
    shape = level_size(photo, rules.level)
    return [Strip(rules.level, shape, row, min(tile, shape[0] - row), rules.half) for row in range(0, shape[0], tile)]


def _refinable(asked: TiePointsStage, photos: Photos, number: int, tile: int) -> Refinable:
    photo = photos.photos[number]
    return Refinable(number, photo.name, _rules(asked, photo, tile), len(_strips(asked, photo, tile)))


def _refinement_job(asked: TiePointsStage, photo: Refinable, partners: tuple[Refinable, ...]) -> Job:
    refined, scatters = refined_tables(photo.name)
    strips = [patch_table(partner.name, number) for partner in partners for number in range(partner.strips)]
    side = 2 * max(one.rules.half for one in (photo, *partners)) + 8
    return Job(
        stage=asked.kind,
        item=f"{photo.name} refinement",
        function=refine_pairs,
        reads={
            "own": observation_table(photo.name),
            "own_patches": tuple(patch_table(photo.name, number) for number in range(photo.strips)),
            "observations": Stream(tuple(observation_table(partner.name) for partner in partners)),
            "patches": Stream(tuple(strips)),
            "cameras": CAMERAS,
        },
        writes={"refined": refined, "scatters": scatters},
        params={"photo": photo, "partners": partners},
        # A batch in mosaics, and the patches of two photographs: those that a pair shares, and all strips of a partner.
        scratch=array_bytes(60 * 1024 + 3 * asked.max_features, side**2),
    )
