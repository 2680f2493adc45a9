"""Matches of pairs, and the tracks over all photographs."""

from typing import NamedTuple

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.job import Job, Raster, Reading, Stream, TextFile
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.photo import Photo, Photos, photo_raster
from orthomill.schemas.raster import Window
from orthomill.tasks.tie_points.correlation_search import correlate_pair
from orthomill.tasks.tie_points.grown_search import grow_pair
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, MatchCounts
from orthomill.tasks.tie_points.matched_features import keep_matched
from orthomill.tasks.tie_points.pair_matching import PairRules, match_pair
from orthomill.tasks.tie_points.plan.tie_point_tables import (
    KEPT,
    LINKS,
    MATCH_COUNTS,
    feature_tables,
    frame_sizes,
    level_size,
    observation_table,
    pair_tables,
    search_level,
)
from orthomill.tasks.tie_points.search_settings import CorrelationSearch, GrowingSearch
from orthomill.tasks.tie_points.stage import TiePointsStage
from orthomill.tasks.tie_points.tracks import observation_key, track_scratch, tracks_of_kept


def pair_job(asked: TiePointsStage, left: Photo, right: Photo) -> Job:
    """The job that finds common points of two photographs, by the search that was asked for."""
    if asked.search.kind == "correlation":
        return _correlation_job(asked, (left, right), asked.search)
    if asked.search.kind == "region_growing":
        return _growing_job(asked, (left, right), asked.search)
    matches, summary = pair_tables(left.name, right.name)
    scale = 2 ** max(search_level(asked, left), search_level(asked, right))
    return Job(
        stage=asked.kind,
        item=f"{left.name}+{right.name} matches",
        function=match_pair,
        reads={"left": feature_tables(left.name), "right": feature_tables(right.name), "cameras": CAMERAS},
        writes={"matches": matches, "summary": summary},
        params={"names": (left.name, right.name), "rules": PairRules(asked.ratio, asked.epipolar_tolerance * scale)},
        scratch=array_bytes(3 * 4 * 1024 + 16 * DESCRIPTOR, asked.max_features),
    )


class _Searched(NamedTuple):
    """Two photographs, complete on their searched levels, and the rules of their pair there."""

    levels: tuple[int, int]
    pixels: tuple[Raster, Raster]
    rules: PairRules


def _searched(asked: TiePointsStage, pair: tuple[Photo, Photo]) -> _Searched:
    left, right = pair
    levels = search_level(asked, left), search_level(asked, right)
    rules = PairRules(asked.ratio, asked.epipolar_tolerance * 2 ** max(levels))
    return _Searched(levels, (_whole(left, levels[0]), _whole(right, levels[1])), rules)


def _whole(photo: Photo, level: int) -> Raster:
    return Raster(photo_raster(photo.name, level), Window(0, 0, *level_size(photo, level)))


def _correlation_job(asked: TiePointsStage, pair: tuple[Photo, Photo], search: CorrelationSearch) -> Job:
    """Reads both photographs completely on the searched level, the size of which `search_side` bounds."""
    left, right = pair
    matches, summary = pair_tables(left.name, right.name)
    searched = _searched(asked, pair)
    return Job(
        stage=asked.kind,
        item=f"{left.name}+{right.name} matches",
        function=correlate_pair,
        reads={"features": tuple(feature_tables(photo.name)[0] for photo in pair), "pixels": searched.pixels, "cameras": CAMERAS},
        writes={"matches": matches, "summary": summary},
        params={"names": (left.name, right.name), "levels": searched.levels, "rules": searched.rules, "search": search},
        scratch=sum(array_bytes(16, pixels.window) for pixels in searched.pixels) + array_bytes(80, search.correlation.search**2),
    )


def _growing_job(asked: TiePointsStage, pair: tuple[Photo, Photo], search: GrowingSearch) -> Job:
    """Reads both photographs completely on the searched level, the size of which `search_side` bounds."""
    left, right = pair
    matches, summary = pair_tables(left.name, right.name)
    searched = _searched(asked, pair)
    reads: dict[str, Reading] = {
        "left": feature_tables(left.name),
        "right": feature_tables(right.name),
        "pixels": searched.pixels,
        "cameras": CAMERAS,
    }
    if search.seeds:
        reads["seeds"] = TextFile(search.seeds)
    return Job(
        stage=asked.kind,
        item=f"{left.name}+{right.name} matches",
        function=grow_pair,
        reads=reads,
        writes={"matches": matches, "summary": summary},
        params={"names": (left.name, right.name), "levels": searched.levels, "rules": searched.rules, "search": search},
        scratch=sum(array_bytes(60, pixels.window) for pixels in searched.pixels)
        + array_bytes(3 * 4 * 1024 + 16 * DESCRIPTOR, asked.max_features),
    )


def count_job(asked: TiePointsStage, photos: Photos, pairs: tuple[tuple[int, int], ...]) -> Job:
    """The job that chooses, of all matched features, those that are kept."""
    matches = Stream(tuple(pair_tables(photos.names[left], photos.names[right])[0] for left, right in pairs))
    return Job(
        stage=asked.kind,
        item="counts",
        function=keep_matched,
        reads={"matches": matches, "again": matches, "features": Stream(tuple(feature_tables(name)[0] for name in photos.names))},
        writes={"counts": MATCH_COUNTS, "kept": KEPT},
        params={"pairs": pairs, "sizes": frame_sizes(photos), "most": asked.max_matched},
        # Two bytes for every feature, eight for every one that is kept, and their sum as it is put together.
        scratch=array_bytes(2 * len(photos.names) + 128, asked.max_features) + array_bytes(24, asked.max_matched),
    )


def track_job(asked: TiePointsStage, photos: Photos, pairs: tuple[tuple[int, int], ...], counts: MatchCounts) -> Job:
    """The job that joins matches of pairs to tie points. `counts` tell how much memory that takes."""
    names = photos.names
    observations = {observation_key(number): observation_table(name) for number, name in enumerate(names)}
    return Job(
        stage=asked.kind,
        item="tracks",
        function=tracks_of_kept,
        reads={
            "features": Stream(tuple(feature_tables(name)[0] for name in names)),
            "matches": Stream(tuple(pair_tables(names[left], names[right])[0] for left, right in pairs)),
            "summaries": tuple(pair_tables(names[left], names[right])[1] for left, right in pairs),
            "kept": KEPT,
        },
        writes={"links": LINKS, **observations},
        params={"pairs": pairs, "sizes": frame_sizes(photos)},
        scratch=track_scratch(counts),
    )
