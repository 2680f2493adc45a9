"""Photographs with another camera constant than the others of their camera: zoom without a tag, another lens, a second one
of the model. They get a camera of their own, if that explains the photographs better than errors of positions do.
"""

from dataclasses import dataclass

from orthomill.schemas.camera import Cameras
from orthomill.schemas.findings.contradiction_findings import ConstantOfItsOwn
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment

SMALLEST = 0.005
"""Cameras of one model differ by a larger share of their constant; less is an error of heights."""
CLEAR = 25.0
"""By so many squares of standard errors, for rays as independent as areas of a frame, the residuals have to be smaller."""
ALIKE = 0.1
"""Share by which the scale of photographs and the constant that positions say may differ: relief and flying heights do as much"""
AREAS = 9
"""Areas of a frame whose rays count as independent: neighbours share their errors."""


@dataclass(frozen=True)
class OwnConstant:
    """`photos` that may have been taken with `factor` times the camera constant of the others."""

    photos: tuple[str, ...]
    factor: float

    @property
    def undone(self) -> "OwnConstant":
        """What takes it back."""
        return OwnConstant(self.photos, 1.0 / self.factor)


def refined(shown: tuple[OwnConstant, ...], by_positions: tuple[OwnConstant, ...]) -> tuple[OwnConstant, ...]:
    """What may be tried, each group of photographs once: those `shown` to be larger, with the constant that positions say of the
    same ones, or of most of them, where both agree (relief and flying heights are in the scale of a photograph, but not in the
    block); and then the others."""
    best, left = [], list(by_positions)
    for own in shown:
        same = [other for other in left if set(other.photos) <= set(own.photos) and 2 * len(other.photos) > len(own.photos)]
        left = [other for other in left if other not in same]
        told = next((other.factor for other in same if abs(other.factor / own.factor - 1.0) < ALIKE), own.factor)
        best.append(OwnConstant(own.photos, told))
    return (*best, *left)


def with_own_constant(cameras: Cameras, own: OwnConstant) -> Cameras:
    """The cameras, with copies of those of the photographs that have another constant."""
    names = {cameras.of_photo[name]: f"{cameras.of_photo[name]}, {own.factor:.3g} times" for name in own.photos}
    copies = {}
    for camera, new in names.items():
        given = cameras.cameras[camera]
        copies[new] = given.changed(c=own.factor * given.c).model_copy(update={"name": new})
    changed = {name: names[cameras.of_photo[name]] for name in own.photos}
    return Cameras(cameras=cameras.cameras | copies, of_photo=cameras.of_photo | changed)


def clearly_less(missed: float, before: float, result: Adjustment) -> bool:
    """Whether a sum of squares of residuals, in standard errors, is so much smaller than the one before that neither chance nor
    errors that neighbouring rays share explain it; `result`: the block of either."""
    per_photo = len(result.rays) / max(result.network.photos, 1)
    return before - missed > CLEAR * max(per_photo / AREAS, 1.0)


def own_constant_findings(own: OwnConstant, before: Cameras, constants: dict[str, float]) -> tuple[ConstantOfItsOwn, ...]:
    """What is told of photographs that got a camera of their own, a finding for each camera that they had; `constants` (px) by the
    names of cameras as they were adjusted."""
    after, found = with_own_constant(before, own), []
    for camera in dict.fromkeys(before.of_photo[name] for name in own.photos):
        photos = tuple(name for name in own.photos if before.of_photo[name] == camera)
        mine, others = constants[after.of_photo[photos[0]]], constants.get(camera, before.cameras[camera].c)
        found.append(ConstantOfItsOwn(photos=photos, camera=camera, c_px=mine, others_px=others))
    return tuple(found)


def apart(found: tuple[ConstantOfItsOwn, ...]) -> bool:
    """Whether constants came out as two: those that came out alike are of one camera, at two heights."""
    return all(abs(one.c_px / one.others_px - 1.0) > SMALLEST for one in found)
