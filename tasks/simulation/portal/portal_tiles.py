"""What the jobs of the portal do: photographs and truth by tiles, the survey and the scan."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.job import Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import ControlRows, MeasurementRows
from orthomill.tasks.simulation.portal.portal_block import portal_block, portal_views
from orthomill.tasks.simulation.portal.portal_rendering import front_orthoimage, lit_scene, photograph_portal, sees
from orthomill.tasks.simulation.portal.portal_scene import PortalScene
from orthomill.tasks.simulation.portal.portal_survey import ScanText, scan_text, scanned_portal, survey_portal

SCAN_TEXT = Table("simulation/scan.json", ScanText)
FRONT = (-3.0, 6.0, 6.0, 6.0)
"""m along the facade and upwards: left edge, upper edge, width and height of the true front orthoimage"""


@dataclass(frozen=True)
class PortalSite:
    """What the jobs share."""

    seed: int
    scene: PortalScene
    noise_sigma: float
    control_sigma: float
    image_sigma: float

    @property
    def front(self) -> MapGrid:
        """The plane of the facade: x along it, y upwards, m from the middle of the door."""
        west, north, wide, high = FRONT
        cell = self.scene.front_pixel
        return MapGrid(west=west, north=north, cell=cell, rows=round(high / cell), cols=round(wide / cell))


class PortalTruth(NamedTuple):
    """The true block, and the grid of the front orthoimage."""

    block: Block
    grid: MapGrid


class FrontTile(NamedTuple):
    """A tile of the true front orthoimage: `ortho` uint8 (rows, cols, 3), `depth` float32 m before the facade, `visible` uint32:
    one bit per photograph that sees the place (people and leaves apart)."""

    ortho: np.ndarray
    depth: np.ndarray
    visible: np.ndarray


class PortalSurvey(NamedTuple):
    """Surveyed targets and their measurements."""

    control: ControlRows
    measurements: MeasurementRows


def describe_portal(site: PortalSite, crs: str) -> PortalTruth:
    """The truth that is no raster."""
    return PortalTruth(portal_block(crs, site.scene.reduction), site.front)


def photograph_of_portal(site: PortalSite, number: int, window: Window) -> np.ndarray:
    """One tile of a photograph."""
    view = portal_views(site.scene.reduction)[number]
    return photograph_portal(view, number, site.seed, site.noise_sigma, window)


def front_of_portal(site: PortalSite, window: Window) -> FrontTile:
    """One tile of the true front orthoimage."""
    grid = site.front
    light, depth = front_orthoimage(grid, window, site.seed)
    x, z = grid.centres(window)
    there = np.isfinite(depth)
    xz = np.stack(np.broadcast_arrays(x[None, :], z[:, None]), axis=2)[there]
    # A tenth of a millimetre before the surface, which would hide its own points by rounding.
    places = np.column_stack([xz[:, 0], -depth[there] - 1e-4, xz[:, 1]])
    visible = np.zeros(window.shape, np.uint32)
    for number, view in enumerate(portal_views(site.scene.reduction)):
        visible[there] |= sees(lit_scene(), view, places).astype(np.uint32) << np.uint32(number)
    return FrontTile(np.clip(light + 0.5, 0, 255).astype(np.uint8), depth, visible)


def portal_survey(site: PortalSite) -> PortalSurvey:
    """The survey of the targets."""
    return PortalSurvey(*survey_portal(site.seed, site.scene.reduction, (site.control_sigma, site.image_sigma)))


def portal_scan(site: PortalSite) -> ScanText:
    """The scanned mesh."""
    return scan_text(scanned_portal(site.seed, site.scene.scan_cell, site.scene.scan_noise))


def portal_raster(name: str) -> str:
    """The photograph that is exported as a file."""
    return f"simulation/photo/{name}"
