"""The scene of a simulation: a town under an aerial block, or the entrance of a church."""

from typing import Annotated, Literal

from pydantic import Field

from orthomill.schemas.settings import Settings, setting


class TownScene(Settings):
    """A town near Volos, photographed from the air."""

    kind: Literal["town"] = "town"
    wood: float = setting(0.0, "Radius of a closed wood of trees up to 12.5 m high; 0: none.", "m", ge=0, le=500)


class PortalScene(Settings):
    """The entrance of a church, photographed from the ground and scanned: columns, steps, an arch and a niche behind it."""

    kind: Literal["portal"]
    reduction: float = setting(1.0, "The photographs have 2592 x 1944 px divided by this number.", ge=1, le=16)
    scan_cell: float = setting(0.025, "Sides of the triangles of the scanned mesh.", "m", ge=0.01, le=0.5)
    scan_noise: float = setting(0.0014, "Standard deviation of the errors of its vertices.", "m", ge=0, le=0.1)
    front_pixel: float = setting(0.002, "Pixel of the true front orthoimage.", "m", ge=0.001, le=0.1)


SceneChoice = Annotated[TownScene | PortalScene, Field(discriminator="kind")]
