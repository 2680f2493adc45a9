"""The balance of the photographs as a job, and the parts of photographs that jobs read."""

from collections.abc import Iterable

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import photo_raster
from orthomill.tasks.colouring.balance.balancing import balanced_block
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.balance.shared_ground import Samples
from orthomill.tasks.colouring.colour_settings import SAMPLES_AT_MOST, ColourSettings
from orthomill.tasks.geometry.photograph_part import PhotoPart

COARSER = 4
"""pixels of the surface per sample pixel of the balance: averaging removes noise and the effect of mismatches of a pixel"""


def radiometry_table(stage: str) -> Table[Radiometry]:
    """The balance that a stage finds."""
    return Table(f"{stage}/radiometry.json", Radiometry)


def balance_job(
    stage: str, settings: ColourSettings, names: tuple[str, ...], dtypes: Iterable[str], samples: Iterable[Table[Samples]]
) -> Job:
    """The balance of the photographs `names`, whose pixels have these `dtypes`, from the samples of all tiles."""
    return Job(
        stage=stage,
        item="balance",
        function=balanced_block,
        reads={"samples": tuple(samples), "block": BLOCK},
        writes={"radiometry": radiometry_table(stage)},
        params={"deep": "uint16" in set(dtypes), "method": settings.balance.kind, "vignetting": settings.vignetting},
        # Bytes per sample and photo that sees it; more than a dozen photos hardly see the same ground.
        scratch=array_bytes(250, SAMPLES_AT_MOST, min(len(names), 12)),
    )


def photo_pixels(parts: Iterable[PhotoPart]) -> tuple[Raster, ...]:
    """What a job reads of photographs."""
    return tuple(Raster(photo_raster(part.name, part.level), part.window) for part in parts)
