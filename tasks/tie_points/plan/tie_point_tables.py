"""The tables between the jobs, and the pyramid levels that they read."""

from orthomill.schemas.job import Raster, Table
from orthomill.schemas.photo import Photo, Photos, photo_raster
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.tie_points.appearance import Candidates
from orthomill.tasks.tie_points.match_records import (
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
from orthomill.tasks.tie_points.stage import TiePointsStage

MATCH_COUNTS = Table("tie_points/match_counts.json", MatchCounts)
KEPT = Table("tie_points/kept.parquet", MatchedFeatures)
LINKS = Table("tie_points/links.json", Links)
CANDIDATES = Table("tie_points/candidates.json", Candidates)
VOCABULARY = Table("tie_points/appearance/vocabulary.parquet", Values)


def feature_tables(name: str) -> tuple[Table[Features], Table[Values]]:
    """The tables of the features and descriptors of a photograph or a part of it."""
    return Table(f"tie_points/features/{name}.parquet", Features), Table(f"tie_points/descriptors/{name}.parquet", Values)


def observation_table(photo: str) -> Table[Observations]:
    """The observations of a photograph, before they are refined."""
    return Table(f"tie_points/observations/{photo}.parquet", Observations)


def patch_table(photo: str, strip: int) -> Table[Values]:
    """Grey values around the observations in a strip of a photograph."""
    return Table(f"tie_points/patches/{photo}/{strip}.parquet", Values)


def pair_tables(left: str, right: str) -> tuple[Table[PairMatches], Table[PairSummary]]:
    """The matches of two photographs, and their summary."""
    name = f"{left}+{right}"
    return Table(f"tie_points/matches/{name}.parquet", PairMatches), Table(f"tie_points/matches/{name}.json", PairSummary)


def refined_tables(photo: str) -> tuple[Table[Refined], Table[Scatters]]:
    """Of all pairs whose first photograph this is."""
    name = f"tie_points/refined/{photo}"
    return Table(f"{name}.parquet", Refined), Table(f"{name}.json", Scatters)


def frame_sizes(photos: Photos) -> tuple[tuple[int, int], ...]:
    """Width and height of each photograph, px."""
    return tuple((photo.width, photo.height) for photo in photos.photos)


def overview(photo: Photo) -> Raster:
    """The coarsest level, from which 16 bits are stretched alike in every part."""
    top = photo.levels - 1
    return Raster(photo_raster(photo.name, top), Window(0, 0, *level_size(photo, top)))


def level_size(photo: Photo, level: int) -> tuple[int, int]:
    """Rows and columns of a pyramid level."""
    rows, cols = level_shape((photo.height, photo.width), level)
    return rows, cols


def search_level(asked: TiePointsStage, photo: Photo) -> int:
    """The level on which points are searched."""
    longer = [max(level_size(photo, level)) for level in range(photo.levels)]
    return next((level for level, side in enumerate(longer) if side <= asked.search_side), photo.levels - 1)


def patch_level(asked: TiePointsStage, photo: Photo) -> int:
    """The level on which observations are refined."""
    # One level finer than the search: SIFT is good to half a pixel there, one pixel here, well within the pull-in range.
    return max(0, search_level(asked, photo) - 1)
