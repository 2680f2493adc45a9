"""The stage `tie_points`: features per tile, matches per pair, tracks over all, patches per strip, refinement per pair.

    photo levels -> features of tiles -> features of photographs -> matches of pairs -> tracks
                                                                                          |
    photo strips -------------------------------------> patches of observations <---------+
                                                           |
                            tie points and report  <- refined pairs of every photograph

Only the feature jobs and the patch jobs read pixels, a part or a strip at a time; all other jobs work on points and patches. (With
`search: correlation` the pairs read the searched level too.)
"""

from collections.abc import Iterator
from itertools import groupby
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Export, Job, Raster, Region, Stream, Table
from orthomill.schemas.observations import TIE_POINT_COUNTS, TIE_POINTS
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.raster import RasterSpec, Tile, Window
from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.matching.least_squares.model import LeastSquaresMatching
from orthomill.tasks.tie_points.appearance import SAMPLE, WORDS, Candidates, Signature, alike, sample, signature, vocabulary
from orthomill.tasks.tie_points.correlation_search import CorrelationSearch, correlate_pair, tile_interest_points
from orthomill.tasks.tie_points.features import Detection, photo_features, searched_parts, tile_features
from orthomill.tasks.tie_points.match_records import (
    DESCRIPTOR,
    Features,
    Links,
    MatchCounts,
    MatchedFeatures,
    Observations,
    PairMatches,
    PairSummary,
    Refined,
    Scatters,
    Values,
)
from orthomill.tasks.tie_points.matched_features import LEAST_SHARE, keep_matched
from orthomill.tasks.tie_points.pair_matching import PairRules, match_pair
from orthomill.tasks.tie_points.pair_selection import Neighbourhood, candidate_pairs, needs_appearance
from orthomill.tasks.tie_points.patches import Strip, strip_patches
from orthomill.tasks.tie_points.refinement import PatchRules, Refinable, refine_pairs
from orthomill.tasks.tie_points.report import finish
from orthomill.tasks.tie_points.tie_point_assembly import Weighting
from orthomill.tasks.tie_points.tracks import observation_key, track_scratch, tracks_of_kept

MATCH_COUNTS = Table("tie_points/match_counts.json", MatchCounts)
KEPT = Table("tie_points/kept.parquet", MatchedFeatures)
LINKS = Table("tie_points/links.json", Links)
CANDIDATES = Table("tie_points/candidates.json", Candidates)
VOCABULARY = Table("tie_points/appearance/vocabulary.parquet", Values)


def _features(name: str) -> tuple[Table[Features], Table[Values]]:
    """The tables of the features and descriptors of a photograph or a part of it."""
    return Table(f"tie_points/features/{name}.parquet", Features), Table(f"tie_points/descriptors/{name}.parquet", Values)


def _observations(photo: str) -> Table[Observations]:
    return Table(f"tie_points/observations/{photo}.parquet", Observations)


def _patches(photo: str, strip: int) -> Table[Values]:
    return Table(f"tie_points/patches/{photo}/{strip}.parquet", Values)


def _pair_tables(left: str, right: str) -> tuple[Table[PairMatches], Table[PairSummary]]:
    name = f"{left}+{right}"
    return Table(f"tie_points/matches/{name}.parquet", PairMatches), Table(f"tie_points/matches/{name}.json", PairSummary)


def _refined_tables(photo: str) -> tuple[Table[Refined], Table[Scatters]]:
    """Of all pairs whose first photograph this is."""
    name = f"tie_points/refined/{photo}"
    return Table(f"{name}.parquet", Refined), Table(f"{name}.json", Scatters)


class FeatureSearch(Settings):
    """Features with descriptors, invariant against scale and rotation."""

    kind: Literal["features"]


Search = Annotated[FeatureSearch | CorrelationSearch, Field(discriminator="kind")]

_OF_DESCRIPTORS = ("ratio", "contrast")


class TiePointsStage(Stage):
    """Finds points that two or more photographs show and refines their measurements."""

    title: ClassVar[str] = "Tie points"
    kind: Literal["tie_points"] = "tie_points"
    search: Search = setting(
        FeatureSearch(kind="features"),
        "How points are found and matched: features with descriptors for photographs of any attitude, or the published interest "
        "points and correlation for near-vertical ones.",
    )
    search_side: int = setting(
        2000, "Points are searched on the pyramid level whose longer side is at most this.", "px", ge=500, le=20000
    )
    max_features: int = setting(8000, "Points kept per photograph.", ge=200, le=100000)
    max_matched: int = setting(
        600_000,
        "Matched points of all photographs together that the block is made from. Of more, every photograph keeps its share, "
        f"{LEAST_SHARE} at least, all over its frame and those that were matched most often first.",
        ge=10_000,
        le=100_000_000,
    )
    contrast: float = setting(
        0.02, "Least contrast of a point (SIFT's threshold); a lower value finds more and weaker points.", gt=0.0, le=0.2
    )
    ratio: float = setting(0.8, "Largest ratio of the best to the second best descriptor distance.", gt=0.3, le=1.0)
    epipolar_tolerance: float = setting(
        1.5, "Distance from the epipolar line up to which a match is accepted.", "px of the searched level", gt=0.0
    )
    all_pairs_up_to: int = setting(15, "Up to this many photographs every pair is compared.", "photographs", ge=2)
    nearest: int = setting(
        10,
        "Of more photographs, each is compared with this many others: those that show the nearest ground, or those most similar to "
        "it where its position is unknown.",
        "photographs",
        ge=2,
        le=100,
    )
    refinement: LeastSquaresMatching = setting(
        LeastSquaresMatching(max_shift=3.0, min_correlation=0.7),
        "Least-squares matching of each observation against the track's reference.",
    )
    sigma_floor: float = setting(
        0.03,
        "Least standard error of an observation; the measured scatter about epipolar lines replaces it when larger.",
        "px",
        gt=0.0,
    )
    sigma_unrefined: float = setting(
        0.7, "Standard error of observations that could not be refined and are kept.", "px of the searched level", gt=0.0
    )
    unrefined: Literal["keep", "drop"] = setting("drop", "Whether observations that could not be refined are kept.")

    @model_validator(mode="after")
    def _has_an_effect(self) -> "TiePointsStage":
        """Raises ValueError for settings that the chosen mode does not read."""
        if self.search.kind == "correlation":
            remedy = "descriptors are not compared: remove the line, or set search: features"
            refuse_ignored(self, _OF_DESCRIPTORS, "search: correlation", remedy)
        if self.unrefined == "drop":
            remedy = "no such observation is kept: remove the line, or set unrefined: keep"
            refuse_ignored(self, ("sigma_unrefined",), "unrefined: drop", remedy)
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Everything up to the tracks at once; patches and refinement when the tracks show which photographs are linked."""
        photos, tile = view.table(PHOTOS), view.project.tile
        if len(photos.photos) < 2:
            raise GeometryError(
                f"The project has a single photograph ({photos.names[0]}); surfaces are measured from two or more that "
                "overlap, so add more."
            )
        for photo in photos.photos:
            yield from self._feature_jobs(photo)
        neighbourhood = Neighbourhood(self.all_pairs_up_to, self.nearest)
        if needs_appearance(photos, neighbourhood):
            yield from self._appearance_jobs(photos, neighbourhood)
            pairs = view.table(CANDIDATES).pairs
        else:
            pairs = candidate_pairs(photos, neighbourhood)
        yield from (self._pair_job(photos.photos[left], photos.photos[right]) for left, right in pairs)
        yield self._count_job(photos, pairs)
        yield self._track_job(photos, pairs, view.table(MATCH_COUNTS))
        links = view.table(LINKS)
        for photo in photos.photos:
            yield from self._patch_jobs(photo, tile)
        yield from self._refinement_jobs(photos, links, tile)
        yield self._last_job(photos, pairs, links)

    def _level(self, photo: Photo) -> int:
        """The level on which points are searched."""
        longer = [max(_level_size(photo, level)) for level in range(photo.levels)]
        return next((level for level, side in enumerate(longer) if side <= self.search_side), photo.levels - 1)

    def _patch_level(self, photo: Photo) -> int:
        """The level on which observations are refined."""
        # One level finer than the search: SIFT is good to half a pixel there, one pixel here, well within the pull-in range.
        return max(0, self._level(photo) - 1)

    def _feature_jobs(self, photo: Photo) -> Iterator[Job]:
        level = self._level(photo)
        parts = []
        for cell in searched_parts(_level_size(photo, level)):
            tables = _features(f"{photo.name}/{cell.row}-{cell.col}")
            parts.append(tables)
            yield self._part_job(photo, level, cell, tables)
        features, descriptors = _features(photo.name)
        yield Job(
            stage=self.kind,
            item=f"{photo.name} chosen",
            function=photo_features,
            reads={"features": tuple(part[0] for part in parts), "descriptors": tuple(part[1] for part in parts)},
            writes={"features": features, "descriptors": descriptors},
            params={"level": level, "max_features": self.max_features},
            scratch=16 * DESCRIPTOR * self.max_features,
        )

    def _part_job(self, photo: Photo, level: int, cell: Tile, tables: tuple[Table[Features], Table[Values]]) -> Job:
        detection = Detection(level, _level_size(photo, level), cell.window, self.max_features, self.contrast)
        by_correlation = self.search.kind == "correlation"
        return Job(
            stage=self.kind,
            item=f"{photo.name} features",
            row=cell.row,
            col=cell.col,
            function=tile_interest_points if by_correlation else tile_features,
            reads={"pixels": Raster(photo_raster(photo.name, level), detection.window), "overview": _overview(photo)},
            writes={"features": tables[0], "descriptors": tables[1]},
            params={"detection": detection, **({"search": self.search} if by_correlation else {})},
            # Bytes per pixel: OpenCV doubles the image and keeps all octaves of Gaussians and their differences as float32.
            scratch=260 * detection.window.height * detection.window.width,
        )

    def _appearance_jobs(self, photos: Photos, neighbourhood: Neighbourhood) -> Iterator[Job]:
        """One signature per photograph, with clusters formed by a sample of all photographs."""
        samples = {name: Table(f"tie_points/appearance/sample/{name}.parquet", Values) for name in photos.names}
        signatures = {name: Table(f"tie_points/appearance/{name}.parquet", Signature) for name in photos.names}
        size = 4 * DESCRIPTOR * self.max_features
        for name in photos.names:
            yield Job(
                stage=self.kind,
                item=f"{name} sample",
                function=sample,
                reads={"photo": _features(name)},
                writes={"sample": samples[name]},
                scratch=size,
            )
        yield Job(
            stage=self.kind,
            item="vocabulary",
            function=vocabulary,
            reads={"samples": tuple(samples.values())},
            writes={"words": VOCABULARY},
            scratch=8 * (DESCRIPTOR + WORDS) * SAMPLE * len(photos.names),
        )
        for name in photos.names:
            reads: dict[str, Region | tuple[Region, ...]] = {"photo": _features(name), "words": VOCABULARY}
            yield Job(
                stage=self.kind,
                item=f"{name} signature",
                function=signature,
                reads=reads,
                writes={"signature": signatures[name]},
                scratch=4 * size,
            )
        yield Job(
            stage=self.kind,
            item="alike",
            function=alike,
            reads={"photos": PHOTOS, "signatures": tuple(signatures.values())},
            writes={"candidates": CANDIDATES},
            params={"neighbourhood": neighbourhood},
            scratch=8 * WORDS * DESCRIPTOR * len(photos.names),
        )

    def _pair_job(self, left: Photo, right: Photo) -> Job:
        if self.search.kind == "correlation":
            return self._correlation_job((left, right), self.search)
        matches, summary = _pair_tables(left.name, right.name)
        scale = 2 ** max(self._level(left), self._level(right))
        return Job(
            stage=self.kind,
            item=f"{left.name}+{right.name} matches",
            function=match_pair,
            reads={"left": _features(left.name), "right": _features(right.name), "cameras": CAMERAS},
            writes={"matches": matches, "summary": summary},
            params={"names": (left.name, right.name), "rules": PairRules(self.ratio, self.epipolar_tolerance * scale)},
            scratch=(3 * 4 * 1024 + 16 * DESCRIPTOR) * self.max_features,
        )

    def _correlation_job(self, pair: tuple[Photo, Photo], search: CorrelationSearch) -> Job:
        """Reads both photographs completely on the searched level, the size of which `search_side` bounds."""
        left, right = pair
        matches, summary = _pair_tables(left.name, right.name)
        levels = self._level(left), self._level(right)
        shapes = [_level_size(photo, level) for photo, level in zip(pair, levels, strict=True)]
        names = [photo_raster(photo.name, level) for photo, level in zip(pair, levels, strict=True)]
        pixels = tuple(Raster(name, Window(0, 0, *shape)) for name, shape in zip(names, shapes, strict=True))
        rules = PairRules(self.ratio, self.epipolar_tolerance * 2 ** max(levels))
        return Job(
            stage=self.kind,
            item=f"{left.name}+{right.name} matches",
            function=correlate_pair,
            reads={"features": tuple(_features(photo.name)[0] for photo in pair), "pixels": pixels, "cameras": CAMERAS},
            writes={"matches": matches, "summary": summary},
            params={"names": (left.name, right.name), "levels": levels, "rules": rules, "search": search},
            scratch=16 * sum(height * width for height, width in shapes) + 80 * search.correlation.search**2,
        )

    def _count_job(self, photos: Photos, pairs: tuple[tuple[int, int], ...]) -> Job:
        matches = Stream(tuple(_pair_tables(photos.names[left], photos.names[right])[0] for left, right in pairs))
        return Job(
            stage=self.kind,
            item="counts",
            function=keep_matched,
            reads={"matches": matches, "again": matches, "features": Stream(tuple(_features(name)[0] for name in photos.names))},
            writes={"counts": MATCH_COUNTS, "kept": KEPT},
            params={"pairs": pairs, "sizes": _sizes(photos), "most": self.max_matched},
            # Two bytes for every feature, eight for every one that is kept, and their sum as it is put together.
            scratch=self.max_features * (2 * len(photos.names) + 128) + 24 * self.max_matched,
        )

    def _track_job(self, photos: Photos, pairs: tuple[tuple[int, int], ...], counts: MatchCounts) -> Job:
        names = photos.names
        observations = {observation_key(number): _observations(name) for number, name in enumerate(names)}
        return Job(
            stage=self.kind,
            item="tracks",
            function=tracks_of_kept,
            reads={
                "features": Stream(tuple(_features(name)[0] for name in names)),
                "matches": Stream(tuple(_pair_tables(names[left], names[right])[0] for left, right in pairs)),
                "summaries": tuple(_pair_tables(names[left], names[right])[1] for left, right in pairs),
                "kept": KEPT,
            },
            writes={"links": LINKS, **observations},
            params={"pairs": pairs, "sizes": _sizes(photos)},
            scratch=track_scratch(counts),
        )

    def _rules(self, photo: Photo, tile: int) -> PatchRules:
        return PatchRules(self._patch_level(photo), tile, self.refinement)

    def _strips(self, photo: Photo, tile: int) -> list[Strip]:
        rules = self._rules(photo, tile)
        shape = _level_size(photo, rules.level)
        return [Strip(rules.level, shape, row, min(tile, shape[0] - row), rules.half) for row in range(0, shape[0], tile)]

    def _patch_jobs(self, photo: Photo, tile: int) -> Iterator[Job]:
        for number, strip in enumerate(self._strips(photo, tile)):
            yield Job(
                stage=self.kind,
                item=f"{photo.name} patches",
                row=number,
                function=strip_patches,
                reads={
                    "pixels": Raster(photo_raster(photo.name, strip.level), strip.window),
                    "overview": _overview(photo),
                    "observations": _observations(photo.name),
                },
                writes={"patches": _patches(photo.name, number)},
                params={"strip": strip},
                # Patches, the grey values of the strip and, of some rows at a time, the numbers that these are made of.
                scratch=(2 * strip.half + 1) ** 2 * self.max_features + 3 * strip.window.height * strip.window.width,
            )

    def _refinement_jobs(self, photos: Photos, links: Links, tile: int) -> Iterator[Job]:
        """One for each photograph that is the first of pairs."""
        for left, pairs in groupby(links.pairs, key=lambda pair: pair[0]):
            partners = tuple(self._refinable(photos, right, tile) for _, right in pairs)
            yield self._refinement_job(self._refinable(photos, left, tile), partners)

    def _refinable(self, photos: Photos, number: int, tile: int) -> Refinable:
        photo = photos.photos[number]
        return Refinable(number, photo.name, self._rules(photo, tile), len(self._strips(photo, tile)))

    def _refinement_job(self, photo: Refinable, partners: tuple[Refinable, ...]) -> Job:
        refined, scatters = _refined_tables(photo.name)
        strips = [_patches(partner.name, number) for partner in partners for number in range(partner.strips)]
        side = 2 * max(one.rules.half for one in (photo, *partners)) + 8
        return Job(
            stage=self.kind,
            item=f"{photo.name} refinement",
            function=refine_pairs,
            reads={
                "own": _observations(photo.name),
                "own_patches": tuple(_patches(photo.name, number) for number in range(photo.strips)),
                "observations": Stream(tuple(_observations(partner.name) for partner in partners)),
                "patches": Stream(tuple(strips)),
                "cameras": CAMERAS,
            },
            writes={"refined": refined, "scatters": scatters},
            params={"photo": photo, "partners": partners},
            # A batch in mosaics, and the patches of two photographs: those that a pair shares, and all strips of a partner.
            scratch=(60 * 1024 + 3 * self.max_features) * side**2,
        )

    def _last_job(self, photos: Photos, pairs: tuple[tuple[int, int], ...], links: Links) -> Job:
        names = photos.names
        # The setting counts pixels of the searched level; with several cameras the coarsest one is the cautious choice.
        coarsest = 2 ** max(self._level(photo) for photo in photos.photos)
        return Job(
            stage=self.kind,
            item="tie points",
            function=finish,
            reads={
                "photos": PHOTOS,
                "links": LINKS,
                "summaries": tuple(_pair_tables(names[left], names[right])[1] for left, right in pairs),
                "observations": tuple(_observations(name) for name in names),
                "refined": tuple(_refined_tables(names[left])[0] for left in links.first),
                "scatters": tuple(_refined_tables(names[left])[1] for left in links.first),
            },
            writes={"tie_points": TIE_POINTS, "counts": TIE_POINT_COUNTS, "report": report_table(self.kind)},
            params={"weighting": Weighting(self.sigma_floor, self.sigma_unrefined * coarsest, self.unrefined)},
            scratch=700 * links.tracks,
        )


def _sizes(photos: Photos) -> tuple[tuple[int, int], ...]:
    return tuple((photo.width, photo.height) for photo in photos.photos)


def _overview(photo: Photo) -> Raster:
    """The coarsest level, from which 16 bits are stretched alike in every part."""
    top = photo.levels - 1
    return Raster(photo_raster(photo.name, top), Window(0, 0, *_level_size(photo, top)))


def _level_size(photo: Photo, level: int) -> tuple[int, int]:
    """Rows and columns of a pyramid level."""
    rows, cols = level_shape((photo.height, photo.width), level)
    return rows, cols
