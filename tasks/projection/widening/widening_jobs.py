"""The jobs that find the limits of what is hidden, draw the zones next to them, and choose how many of these are used."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import prod

from orthomill.schemas.job import Job, Raster, Reading, Stream, Table
from orthomill.schemas.raster import RasterSpec, Tile, Window
from orthomill.tasks.colouring.surface_colours import ColourRules
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth, HiddenEdges, WideningRules, edge_tile, limit_zone
from orthomill.tasks.projection.projection_jobs import ColourJobs, output_layer, zones_layer
from orthomill.tasks.projection.widening.width_trials import WidthTrial, choose_width, try_widths

WIDENING = Table("projection/widening.json", ChosenWidth)


def edges_table(name: str, tile: Tile) -> Table[HiddenEdges]:
    """Edges of what is hidden in a tile of an output."""
    return Table(f"projection/edges/{name}/{tile.row}-{tile.col}.parquet", HiddenEdges)


def trial_table(name: str, tile: Tile) -> Table[WidthTrial]:
    """What a tile of an output tells of the widths."""
    return Table(f"projection/widths/{name}/{tile.row}-{tile.col}.json", WidthTrial)


def fixed_width(width: float) -> ChosenWidth:
    """The width that a workflow states."""
    return ChosenWidth(zone=1, width=width)


@dataclass(frozen=True, eq=False)
class WideningJobs:
    """Of an output."""

    colour: ColourJobs
    rules: WideningRules

    def zones(self) -> Iterator[RasterSpec | Job]:
        """The limits of what is hidden, tile by tile, and their zones in every photograph."""
        colour, frame, rules = self.colour, self.colour.frame, self.rules
        for tile, surface in colour.pairs():
            around = tile.window.grown(rules.rim).clipped(frame.frame.shape)
            reads: dict[str, Reading] = {
                "triangle": Raster(output_layer(frame.name, "triangle"), around),
                "sight": Raster(output_layer(frame.name, "sight"), around),
                **colour.surface_reads(surface),
            }
            params = {"tile": colour.tile(tile, surface), "around": around, "rules": rules}
            writes = {"edges": edges_table(frame.name, tile)}
            yield frame.job("edges", tile, edge_tile, reads, writes, params, scratch=64 * prod(around.shape))
        for number, name in enumerate(frame.photographs):
            camera = colour.basis.views[name].camera
            shape, layer = (camera.height, camera.width), zones_layer(frame.name, name)
            yield RasterSpec(name=layer, shape=shape, dtype="uint8", chunk=colour.basis.tile)
            edges = Stream(tuple(edges_table(frame.name, tile) for tile in frame.tiles))
            yield Job(
                "projection",
                f"{frame.name}-limits-{name}",
                limit_zone,
                {"edges": edges},
                {"zone": Raster(layer, Window(0, 0, *shape))},
                {"number": number, "shape": shape, "widths": rules.widths},
                scratch=8 * prod(shape),
            )

    def trials(self, rules: ColourRules) -> Iterator[Job]:
        """How well the widths do in every tile."""
        for tile, surface in self.colour.pairs():
            zoned, reads = self.colour.zoned_reads(tile, surface)
            writes = {"trial": trial_table(self.colour.frame.name, tile)}
            params = {"tile": zoned, "rules": rules}
            scratch = self.colour.colour_scratch(tile, zoned.parts) // 4
            yield self.colour.frame.job("widths", tile, try_widths, reads, writes, params, scratch=scratch)


def choice(outputs: list[WideningJobs], width: float | None) -> Job:
    """The width for all outputs: the given one, or the best of their trials."""
    writes: dict[str, Raster | Table] = {"widening": WIDENING}
    if width is not None:
        return Job("projection", "widening", fixed_width, {}, writes, {"width": width})
    every = Stream(tuple(trial_table(jobs.colour.frame.name, tile) for jobs in outputs for tile in jobs.colour.frame.tiles))
    return Job("projection", "widening", choose_width, {"trials": every}, writes)
