"""The stage `tie_points`: features per tile, matches per pair, tracks over all, patches per strip, refinement per pair.

    photo levels -> features of tiles -> features of photographs -> matches of pairs -> tracks
                                                                                          |
    photo strips -------------------------------------> patches of observations <---------+
                                                           |
                            tie points and report  <- refined pairs

Only the first and the patch jobs see pixels, a tile or a strip of tiles at a time; whatever follows works on points and patches.
"""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Export, Job, Raster, Table
from orthomill.schemas.observations import TIE_POINTS
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.settings import Settings, setting
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
    Observations,
    PairMatches,
    PairSummary,
    Refined,
    Scatter,
    Values,
)
from orthomill.tasks.tie_points.pair_matching import PairRules, match_pair
from orthomill.tasks.tie_points.pair_selection import Neighbourhood, candidate_pairs, needs_appearance
from orthomill.tasks.tie_points.patches import Strip, strip_patches
from orthomill.tasks.tie_points.refinement import PatchRules, refine_pair
from orthomill.tasks.tie_points.report import finish
from orthomill.tasks.tie_points.tie_point_assembly import Weighting
from orthomill.tasks.tie_points.tracks import build_tracks, observation_key

LINKS = Table("tie_points/links.json", Links)
CANDIDATES = Table("tie_points/candidates.json", Candidates)
VOCABULARY = Table("tie_points/appearance/vocabulary.parquet", Values)


def _features(name: str) -> tuple[Table[Features], Table[Values]]:
    """Where features and descriptors of a photograph or a tile are stored."""
    return Table(f"tie_points/features/{name}.parquet", Features), Table(f"tie_points/descriptors/{name}.parquet", Values)


def _observations(photo: str) -> Table[Observations]:
    return Table(f"tie_points/observations/{photo}.parquet", Observations)


def _patches(photo: str, strip: int) -> Table[Values]:
    return Table(f"tie_points/patches/{photo}/{strip}.parquet", Values)


def _pair_tables(left: str, right: str) -> tuple[Table[PairMatches], Table[PairSummary]]:
    name = f"{left}+{right}"
    return Table(f"tie_points/matches/{name}.parquet", PairMatches), Table(f"tie_points/matches/{name}.json", PairSummary)


def _refined_tables(left: str, right: str) -> tuple[Table[Refined], Table[Scatter]]:
    name = f"tie_points/refined/{left}+{right}"
    return Table(f"{name}.parquet", Refined), Table(f"{name}.json", Scatter)


class FeatureSearch(Settings):
    """Features with descriptors, whatever their scale and direction."""

    kind: Literal["features"]


Search = Annotated[FeatureSearch | CorrelationSearch, Field(discriminator="kind")]


class TiePointsStage(Stage):
    """Finds and refines points that two or more photographs show."""

    title: ClassVar[str] = "Tie points"
    kind: Literal["tie_points"] = "tie_points"
    search: Search = setting(
        FeatureSearch(kind="features"),
        "How points are found and matched: features with descriptors for photographs in any position, or the published interest "
        "points and correlation for near-vertical ones.",
    )
    search_side: int = setting(
        2000, "Points are searched on the pyramid level whose longer side is at most this.", "px", ge=500, le=20000
    )
    max_features: int = setting(8000, "Points searched per photograph.", ge=200, le=100000)
    contrast: float = setting(
        0.02, "Least contrast of a point (SIFT's threshold); lower finds more and weaker ones.", gt=0.0, le=0.2
    )
    ratio: float = setting(0.8, "Largest ratio of the best to the second best descriptor distance.", gt=0.3, le=1.0)
    epipolar_tolerance: float = setting(
        1.5, "Distance from the epipolar line up to which a match agrees.", "px of the searched level", gt=0.0
    )
    all_pairs_up_to: int = setting(15, "Up to this many photographs every pair is compared.", "photographs", ge=2)
    nearest: int = setting(
        10,
        "Beyond, each photograph is compared with this many others: those that look at the nearest places, or those most like it "
        "where its position is not known.",
        "photographs",
        ge=2,
        le=100,
    )
    refinement: LeastSquaresMatching = setting(
        LeastSquaresMatching(max_shift=3.0, min_correlation=0.7),
        "Least-squares matching of each observation against the track's reference.",
    )
    sigma_floor: float = setting(
        0.03, "Standard error that no observation goes below; the scatter about epipolar lines counts when larger.", "px", gt=0.0
    )
    sigma_unrefined: float = setting(
        0.7, "Standard error of observations that could not be refined.", "px of the searched level", gt=0.0
    )
    unrefined: Literal["keep", "drop"] = setting("drop", "What becomes of observations that could not be refined.")

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Everything up to the tracks at once; patches and refinement when the tracks tell which photographs are linked."""
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
        for left, right in pairs:
            yield self._pair_job(photos.photos[left], photos.photos[right])
        yield self._track_job(photos, pairs)
        links = view.table(LINKS)
        for photo in photos.photos:
            yield from self._patch_jobs(photo, tile)
        for left, right in links.pairs:
            yield self._refinement_job(photos, (left, right), tile)
        yield self._last_job(photos, pairs, links)

    def _level(self, photo: Photo) -> int:
        """The level on which points are searched."""
        longer = [max(level_shape((photo.height, photo.width), level)) for level in range(photo.levels)]
        return next((level for level, side in enumerate(longer) if side <= self.search_side), photo.levels - 1)

    def _patch_level(self, photo: Photo) -> int:
        """Refinement goes one level finer than the search, as far as its pull-in range reaches."""
        return max(0, self._level(photo) - 1)

    def _feature_jobs(self, photo: Photo) -> Iterator[Job]:
        level = self._level(photo)
        shape = level_shape((photo.height, photo.width), level)
        parts = []
        by_features = self.search.kind == "features"
        function, more = (tile_features, {}) if by_features else (tile_interest_points, {"search": self.search})
        for cell in searched_parts(shape):
            detection = Detection(level, shape, cell.window, self.max_features, self.contrast)
            features, descriptors = _features(f"{photo.name}/{cell.row}-{cell.col}")
            parts.append((features, descriptors))
            yield Job(
                stage=self.kind, item=f"{photo.name} features", row=cell.row, col=cell.col, function=function,
                reads={"pixels": Raster(photo_raster(photo.name, level), detection.window), "overview": _overview(photo)},
                writes={"features": features, "descriptors": descriptors}, params={"detection": detection, **more},
                scratch=260 * detection.window.height * detection.window.width,
            )  # fmt: skip
        features, descriptors = _features(photo.name)
        yield Job(
            stage=self.kind, item=f"{photo.name} chosen", function=photo_features,
            reads={"features": tuple(part[0] for part in parts), "descriptors": tuple(part[1] for part in parts)},
            writes={"features": features, "descriptors": descriptors}, params={"level": level, "max_features": self.max_features},
            scratch=16 * DESCRIPTOR * self.max_features,
        )  # fmt: skip

    def _appearance_jobs(self, photos: Photos, neighbourhood: Neighbourhood) -> Iterator[Job]:
        """One signature per photograph, from heaps that a sample of all photographs forms."""
        samples = {name: Table(f"tie_points/appearance/sample/{name}.parquet", Values) for name in photos.names}
        signatures = {name: Table(f"tie_points/appearance/{name}.parquet", Signature) for name in photos.names}
        size = 4 * DESCRIPTOR * self.max_features
        for name in photos.names:
            yield Job(self.kind, f"{name} sample", sample, {"photo": _features(name)}, {"sample": samples[name]}, scratch=size)
        yield Job(
            self.kind, "vocabulary", vocabulary, {"samples": tuple(samples.values())}, {"words": VOCABULARY},
            scratch=8 * (DESCRIPTOR + WORDS) * SAMPLE * len(photos.names),
        )  # fmt: skip
        for name in photos.names:
            reads = {"photo": _features(name), "words": VOCABULARY}
            yield Job(self.kind, f"{name} signature", signature, reads, {"signature": signatures[name]}, scratch=4 * size)
        yield Job(
            self.kind, "alike", alike, {"photos": PHOTOS, "signatures": tuple(signatures.values())}, {"candidates": CANDIDATES},
            {"neighbourhood": neighbourhood}, scratch=8 * WORDS * DESCRIPTOR * len(photos.names),
        )  # fmt: skip

    def _pair_job(self, left: Photo, right: Photo) -> Job:
        if self.search.kind == "correlation":
            return self._correlation_job(left, right)
        matches, summary = _pair_tables(left.name, right.name)
        scale = 2 ** max(self._level(left), self._level(right))
        return Job(
            stage=self.kind, item=f"{left.name}+{right.name} matches", function=match_pair,
            reads={"left": _features(left.name), "right": _features(right.name), "cameras": CAMERAS},
            writes={"matches": matches, "summary": summary},
            params={"names": (left.name, right.name), "rules": PairRules(self.ratio, self.epipolar_tolerance * scale)},
            scratch=(3 * 4 * 1024 + 16 * DESCRIPTOR) * self.max_features,
        )  # fmt: skip

    def _correlation_job(self, left: Photo, right: Photo) -> Job:
        """Both photographs whole on the searched level, whose size is bounded."""
        matches, summary = _pair_tables(left.name, right.name)
        levels = self._level(left), self._level(right)
        shapes = [level_shape((photo.height, photo.width), level) for photo, level in zip((left, right), levels, strict=True)]
        pixels = [
            Raster(photo_raster(photo.name, level), Window(0, 0, *shape))
            for photo, level, shape in zip((left, right), levels, shapes, strict=True)
        ]
        rules = PairRules(self.ratio, self.epipolar_tolerance * 2 ** max(levels))
        return Job(
            stage=self.kind, item=f"{left.name}+{right.name} matches", function=correlate_pair,
            reads={
                "left": _features(left.name)[0], "right": _features(right.name)[0],
                "left_pixels": pixels[0], "right_pixels": pixels[1], "cameras": CAMERAS,
            },
            writes={"matches": matches, "summary": summary},
            params={"names": (left.name, right.name), "levels": levels, "rules": rules, "search": self.search},
            scratch=16 * sum(height * width for height, width in shapes) + 80 * self.search.correlation.search**2,
        )  # fmt: skip

    def _track_job(self, photos: Photos, pairs: tuple[tuple[int, int], ...]) -> Job:
        names = photos.names
        writes: dict[str, Any] = {observation_key(number): _observations(name) for number, name in enumerate(names)}
        return Job(
            stage=self.kind, item="tracks", function=build_tracks,
            reads={
                "features": tuple(_features(name)[0] for name in names),
                "matches": tuple(_pair_tables(names[left], names[right])[0] for left, right in pairs),
                "summaries": tuple(_pair_tables(names[left], names[right])[1] for left, right in pairs),
            },
            writes={"links": LINKS, **writes},
            params={"pairs": pairs, "sizes": tuple((photo.width, photo.height) for photo in photos.photos)},
            scratch=300 * self.max_features * len(names),
        )  # fmt: skip

    def _rules(self, photo: Photo, tile: int) -> PatchRules:
        return PatchRules(self._patch_level(photo), tile, self.refinement)

    def _strips(self, photo: Photo, tile: int) -> list[Strip]:
        rules = self._rules(photo, tile)
        shape = level_shape((photo.height, photo.width), rules.level)
        return [Strip(rules.level, shape, row, min(tile, shape[0] - row), rules.half) for row in range(0, shape[0], tile)]

    def _patch_jobs(self, photo: Photo, tile: int) -> Iterator[Job]:
        for number, strip in enumerate(self._strips(photo, tile)):
            yield Job(
                stage=self.kind, item=f"{photo.name} patches", row=number, function=strip_patches,
                reads={
                    "pixels": Raster(photo_raster(photo.name, strip.level), strip.window),
                    "overview": _overview(photo),
                    "observations": _observations(photo.name),
                },
                writes={"patches": _patches(photo.name, number)}, params={"strip": strip},
                scratch=(2 * strip.half + 1) ** 2 * (self.max_features + 512 * 40),
            )  # fmt: skip

    def _refinement_job(self, photos: Photos, pair: tuple[int, int], tile: int) -> Job:
        left, right = (photos.photos[number] for number in pair)
        sides = [tuple(_patches(photo.name, number) for number in range(len(self._strips(photo, tile)))) for photo in (left, right)]
        rules = (self._rules(left, tile), self._rules(right, tile))
        refined, scatter = _refined_tables(left.name, right.name)
        return Job(
            stage=self.kind, item=f"{left.name}+{right.name} refinement", function=refine_pair,
            reads={
                "observations": (_observations(left.name), _observations(right.name)),
                "left_patches": sides[0],
                "right_patches": sides[1],
                "cameras": CAMERAS,
            },
            writes={"refined": refined, "scatter": scatter},
            params={"photos": pair, "names": (left.name, right.name), "rules": rules},
            scratch=60 * 1024 * (2 * rules[0].half + 8) ** 2,
        )  # fmt: skip

    def _last_job(self, photos: Photos, pairs: tuple[tuple[int, int], ...], links: Links) -> Job:
        names = photos.names
        coarsest = 2 ** max(self._level(photo) for photo in photos.photos)
        return Job(
            stage=self.kind, item="tie points", function=finish,
            reads={
                "photos": PHOTOS,
                "links": LINKS,
                "summaries": tuple(_pair_tables(names[left], names[right])[1] for left, right in pairs),
                "observations": tuple(_observations(name) for name in names),
                "refined": tuple(_refined_tables(names[left], names[right])[0] for left, right in links.pairs),
                "scatters": tuple(_refined_tables(names[left], names[right])[1] for left, right in links.pairs),
            },
            writes={"tie_points": TIE_POINTS, "report": report_table(self.kind)},
            params={"weighting": Weighting(self.sigma_floor, self.sigma_unrefined * coarsest, self.unrefined)},
            scratch=700 * links.tracks,
        )  # fmt: skip


def _overview(photo: Photo) -> Raster:
    top = photo.levels - 1
    height, width = level_shape((photo.height, photo.width), top)
    return Raster(photo_raster(photo.name, top), Window(0, 0, height, width))
