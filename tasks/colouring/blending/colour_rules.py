"""By which rules the colours of photographs are weighted and become one, the same on every surface."""

from dataclasses import dataclass

from orthomill.schemas.camera import Camera
from orthomill.tasks.colouring.blending.blending import Blend


@dataclass(frozen=True)
class ColourRules:
    """`feather`: width of the soft border, a part of the photograph's shorter side; `blend`: how colours are combined; of two that
    disagree the one at a break of its depth goes if `breaks`, instead of the lighter one."""

    feather: float
    blend: Blend
    breaks: bool = False
    finest: bool = False
    """photographs with much larger pixels than the finest one fade out"""

    def border(self, camera: Camera) -> float:
        """Width of the soft border of a photograph, px."""
        return self.feather * min(camera.width, camera.height)
