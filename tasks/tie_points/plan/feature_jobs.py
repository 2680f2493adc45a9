"""Features of tiles, of photographs, and how alike the photographs are by them."""

from collections.abc import Iterator

from orthomill.schemas.job import Job, Raster, Region, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.raster import Tile
from orthomill.tasks.tie_points.appearance import SAMPLE, WORDS, Signature, alike, sample, signature, vocabulary
from orthomill.tasks.tie_points.correlation_search import tile_interest_points
from orthomill.tasks.tie_points.features import Detection, photo_features, searched_parts, tile_features
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, Values
from orthomill.tasks.tie_points.pair_selection import Neighbourhood
from orthomill.tasks.tie_points.plan.tie_point_tables import (
    CANDIDATES,
    VOCABULARY,
    feature_tables,
    level_size,
    overview,
    search_level,
)
from orthomill.tasks.tie_points.stage import TiePointsStage


def feature_jobs(asked: TiePointsStage, photo: Photo) -> Iterator[Job]:
    """The jobs that find the features of a photograph: by parts, then the strongest of all parts."""
    level = search_level(asked, photo)
    parts = []
    for cell in searched_parts(level_size(photo, level)):
        tables = feature_tables(f"{photo.name}/{cell.row}-{cell.col}")
        parts.append(tables)
        yield _part_job(asked, photo, level, cell, tables)
    features, descriptors = feature_tables(photo.name)
    yield Job(
        stage=asked.kind,
        item=f"{photo.name} chosen",
        function=photo_features,
        reads={"features": tuple(part[0] for part in parts), "descriptors": tuple(part[1] for part in parts)},
        writes={"features": features, "descriptors": descriptors},
        params={"level": level, "max_features": asked.max_features},
        scratch=array_bytes(16, DESCRIPTOR, asked.max_features),
    )


def _part_job(asked: TiePointsStage, photo: Photo, level: int, cell: Tile, tables: tuple[Table[Features], Table[Values]]) -> Job:
    detection = Detection(level, level_size(photo, level), cell.window, asked.max_features, asked.contrast)
    by_correlation = asked.search.kind == "correlation"
    return Job(
        stage=asked.kind,
        item=f"{photo.name} features",
        row=cell.row,
        col=cell.col,
        function=tile_interest_points if by_correlation else tile_features,
        reads={"pixels": Raster(photo_raster(photo.name, level), detection.window), "overview": overview(photo)},
        writes={"features": tables[0], "descriptors": tables[1]},
        params={"detection": detection, **({"search": asked.search} if by_correlation else {})},
        # Bytes per pixel: OpenCV doubles the image and keeps all octaves of Gaussians and their differences as float32.
        scratch=array_bytes(260, detection.window),
    )


def appearance_jobs(asked: TiePointsStage, photos: Photos, neighbourhood: Neighbourhood) -> Iterator[Job]:
    """One signature per photograph, with clusters formed by a sample of all photographs."""
    samples = {name: Table(f"tie_points/appearance/sample/{name}.parquet", Values) for name in photos.names}
    signatures = {name: Table(f"tie_points/appearance/{name}.parquet", Signature) for name in photos.names}
    descriptors = DESCRIPTOR * asked.max_features
    for name in photos.names:
        yield Job(
            stage=asked.kind,
            item=f"{name} sample",
            function=sample,
            reads={"photo": feature_tables(name)},
            writes={"sample": samples[name]},
            scratch=array_bytes(4, descriptors),
        )
    yield Job(
        stage=asked.kind,
        item="vocabulary",
        function=vocabulary,
        reads={"samples": tuple(samples.values())},
        writes={"words": VOCABULARY},
        scratch=array_bytes(8, DESCRIPTOR + WORDS, SAMPLE, len(photos.names)),
    )
    for name in photos.names:
        reads: dict[str, Region | tuple[Region, ...]] = {"photo": feature_tables(name), "words": VOCABULARY}
        yield Job(
            stage=asked.kind,
            item=f"{name} signature",
            function=signature,
            reads=reads,
            writes={"signature": signatures[name]},
            scratch=array_bytes(16, descriptors),
        )
    yield Job(
        stage=asked.kind,
        item="alike",
        function=alike,
        reads={"photos": PHOTOS, "signatures": tuple(signatures.values())},
        writes={"candidates": CANDIDATES},
        params={"neighbourhood": neighbourhood},
        scratch=array_bytes(8, WORDS, DESCRIPTOR, len(photos.names)),
    )
