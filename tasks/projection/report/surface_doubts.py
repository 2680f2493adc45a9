"""A surface that is not what one expects, or that photographs disagree with, in sentences: what, where, what to do."""

from collections.abc import Iterator
from math import inf
from statistics import median

from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.projection.photographs.leave_one_out import LeftOutPhotograph

FEW = 4
"""triangles that are too few for a surface"""
_UNRELATED, _SMALL = 14.0, 0.02
"""dB of photographs made again from the others below which they show different things; part of the photographs that is too little
for a surface that they were taken of"""
_BACKS, _UNLIKE = 0.2, 1.5
"""part of backs that is worth a warning; a photograph whose difference is so many times the median disagrees with the block"""


def unrelated(compared: tuple[LeftOutPhotograph, ...]) -> bool:
    """Whether the photographs show different things on the surface."""
    psnr = usual([one.blended.psnr for one in compared if one.blended])
    return psnr is not None and psnr < _UNRELATED


def usual(values: list[float]) -> float | None:
    """The median of some values, if there are any."""
    return median(values) if values else None


def mesh_doubts(census: MeshCensus) -> Iterator[str]:
    """What the mesh is, where it is not what one expects."""
    if census.triangles < FEW:
        count = "one triangle" if census.triangles == 1 else f"{census.triangles} triangles"
        yield f"The surface has {count} only, {census.size:.4g} m large: is it the right file, or was it decimated too far?"
    if census.triangulated:
        yield (
            f"The file of the surface has no triangles: its {census.vertices} points were joined in the plane that fits them best, "
            "with one depth at each place. Overhangs need a mesh."
        )
    if census.turned_edges:
        yield (
            f"{census.turned_edges} edges of the mesh lie between triangles that face opposite ways: parts of it are inside out "
            "and stay without colour. Let the program that made it orient its faces."
        )


def hole_doubts(facing: MeshFacing) -> Iterator[str]:
    """Photographs that see the inside of the mesh."""
    backs = [one.photo for one in facing.photos if one.backs > _BACKS * max(one.fronts + one.backs, 1e-9)]
    if backs:
        yield (
            f"{', '.join(backs[:6])} look at the backs of triangles: the mesh has holes there, and nothing behind them is "
            "coloured. Close the holes, or leave these photographs out where they disturb."
        )


def strange_doubts(facing: MeshFacing, compared: tuple[LeftOutPhotograph, ...]) -> Iterator[str]:
    """A surface that the photographs were hardly taken of."""
    largest = max((one.fronts + one.backs for one in facing.photos), default=1.0)
    if unrelated(compared):
        yield (
            "Made again from the others, the photographs are unlike themselves throughout: on this surface they show different "
            "things. The unit of the surface or its place is wrong, or it belongs to another orientation."
        )
    if largest < _SMALL:
        yield (
            f"The surface fills {100 * largest:.1f} % of a photograph at most: is its unit the right one, and is it what was "
            "photographed?"
        )


def unlike_doubts(compared: tuple[LeftOutPhotograph, ...]) -> Iterator[str]:
    """Photographs that are unlike what the others show of the same places."""
    differences = [one.difference for one in compared if one.difference is not None]
    middle = median(differences) if len(differences) > 2 else inf
    for one in compared:
        if one.difference is not None and one.difference > _UNLIKE * middle:
            yield (
                f"{one.photo} disagrees with the others: it differs by {one.difference:.1f} grey levels where {middle:.1f} are "
                "usual. Its orientation or its brightness is wrong, or something moved; look at its picture below."
            )


def mended(census: MeshCensus, facing: MeshFacing) -> Iterator[str]:
    """What was done about the mesh, which costs nothing."""
    if facing.turned:
        yield "The triangles of the mesh face inwards: it was turned, because the photographs see more of their backs than fronts."
    mended = census.not_finite + census.degenerate + census.duplicate
    if mended:
        yield (
            f"{mended} of {census.read} triangles of the mesh were left out: {census.not_finite} not finite, {census.degenerate} "
            f"without area, {census.duplicate} twice."
        )
