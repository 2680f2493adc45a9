"""Which way the triangles of a mesh face: a mesh whose backs the photographs see is turned as a whole."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

from orthomill.tasks.visibility.mesh_blocks import PhotoDepth


class PhotoFacing(BaseModel):
    """How much of the mesh a photograph sees from its front and from its back, as parts of its pixels."""

    model_config = ConfigDict(frozen=True)

    photo: str
    fronts: float
    backs: float


class MeshFacing(BaseModel):
    """`sign`: -1 where the front of a triangle is where its corners run clockwise."""

    model_config = ConfigDict(frozen=True)

    sign: float
    turned: bool
    photos: tuple[PhotoFacing, ...]


def mesh_facing(seen: tuple[PhotoDepth, ...], names: tuple[str, ...], faces: Literal["auto", "outwards", "inwards"]) -> MeshFacing:
    """The way in which the photographs see more fronts than backs, unless `faces` says it."""
    fronts, backs = sum(one.fronts for one in seen), sum(one.backs for one in seen)
    turned = faces == "inwards" or (faces == "auto" and backs > fronts)
    parts = [(one.backs, one.fronts) if turned else (one.fronts, one.backs) for one in seen]
    photos = tuple(
        PhotoFacing(photo=name, fronts=front / one.pixels, backs=back / one.pixels)
        for name, one, (front, back) in zip(names, seen, parts, strict=True)
    )
    return MeshFacing(sign=-1.0 if turned else 1.0, turned=turned, photos=photos)
