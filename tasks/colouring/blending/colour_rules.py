"""By which rules the colours of photographs are weighted and become one, the same on every surface."""

from dataclasses import dataclass

from orthomill.schemas.camera import Camera
from orthomill.tasks.colouring.blending.blending import Blend
from orthomill.tasks.colouring.blending.rejection import CentreName, Rejection
from orthomill.tasks.colouring.colour_settings import ColourSettings


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


_CENTRE: dict[str, CentreName] = {"mean": "mean", "median": "median", "robust": "deviation"}


def colour_rules_of(settings: ColourSettings) -> ColourRules:
    """The rules that the settings stand for."""
    choice, two = settings.rejection, settings.two_colours
    rejection = Rejection("none") if choice.kind == "none" else Rejection(_CENTRE[choice.kind], choice.k, choice.least)
    power = 2 if settings.weights.kind == "area_squared" else 1
    limit = 0.0 if two.kind == "average" else two.limit
    blended = Blend(rejection, power, best=0 if settings.best == "auto" else settings.best, two_limit=limit)
    return ColourRules(settings.feather, blended, breaks=two.kind == "depth_break", finest=settings.best == "auto")
