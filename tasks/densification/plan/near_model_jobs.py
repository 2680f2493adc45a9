"""The raster and the job of the posts of an existing model, near which the strategies of pairs search."""

from collections.abc import Iterator

from orthomill.schemas.job import Job, MapFile, Raster, Reading
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import RasterSpec, Window, map_raster
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.settings.guide_settings import GuideFile
from orthomill.tasks.densification.strategies.near_model import CHUNK, model_posts
from orthomill.tasks.densification.volume.guide_posts import file_guide

MODEL = "densification/model"
"""(rows, cols, 4) float32 m at posts: height of the existing model, lowest and highest height near it, and whether it was known"""


def model_plan(guide: GuideFile, surface: Surface, stage: str, crs: str) -> Iterator[RasterSpec | Job]:
    """The posts of an existing model, in one piece."""
    grid = model_posts(surface)
    whole, axes = Window(0, 0, *grid.shape), ("model_y", "model_x")
    yield map_raster(MODEL, grid, "float32", crs, CHUNK, nodata=float("nan"), unit="m", bands=4, axes=axes)
    reads: dict[str, Reading] = {"points": GROUND_POINTS, "block": BLOCK, "guide": MapFile(guide.path, crs, grid, whole)}
    params = {"grid": grid, "path": guide.path, "surface": surface}
    scratch = array_bytes(100, grid)
    yield Job(
        stage=stage,
        item="model",
        function=file_guide,
        reads=reads,
        writes={"posts": Raster(MODEL, whole)},
        params=params,
        scratch=scratch,
    )
