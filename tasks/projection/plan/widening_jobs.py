"""The jobs that find the limits of what is hidden, draw the zones next to them, and choose how many of these are used."""

from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.job import Job, Raster, Stream
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.widening.hidden_edges import WideningRules, edge_tile, fixed_width, limit_zone
from orthomill.tasks.projection.plan.output_jobs import OutputJobs
from orthomill.tasks.projection.plan.projection_tables import WIDENING, edges_table, output_layer, trial_table, zones_layer
from orthomill.tasks.projection.tiles.width_trials import choose_width, try_widths


@dataclass(frozen=True, eq=False)
class WideningJobs:
    """Of an output."""

    output: OutputJobs
    rules: WideningRules

    def zones(self) -> Iterator[RasterSpec | Job]:
        """The limits of what is hidden, tile by tile, and their zones in every photograph."""
        output, frame, rules = self.output, self.output.frame, self.rules
        for tile, surface in output.pairs():
            around = tile.window.grown(rules.rim).clipped(frame.frame.shape)
            yield frame.job(
                "edges",
                tile,
                function=edge_tile,
                reads={
                    "triangle": Raster(output_layer(frame.name, "triangle"), around),
                    "sight": Raster(output_layer(frame.name, "sight"), around),
                    **output.surface_reads(surface),
                },
                writes={"edges": edges_table(frame.name, tile)},
                params={"tile": output.tile(tile, surface), "around": around, "rules": rules},
                scratch=array_bytes(64, around),
            )
        edges = Stream(tuple(edges_table(frame.name, tile) for tile in frame.tiles))
        for number, name in enumerate(frame.photographs):
            camera = output.basis.views[name].camera
            shape, layer = (camera.height, camera.width), zones_layer(frame.name, name)
            yield RasterSpec(name=layer, shape=shape, dtype="uint8", chunk=output.basis.tile)
            yield Job(
                stage="projection",
                item=f"{frame.name}-limits-{name}",
                function=limit_zone,
                reads={"edges": edges},
                writes={"zone": Raster(layer, Window(0, 0, *shape))},
                params={"number": number, "shape": shape, "widths": rules.widths},
                scratch=array_bytes(8, shape),
            )

    def trials(self, rules: ColourRules) -> Iterator[Job]:
        """How well the widths do in every tile."""
        for tile, surface in self.output.pairs():
            zoned, reads = self.output.zoned_reads(tile, surface)
            yield self.output.frame.job(
                "widths",
                tile,
                function=try_widths,
                reads=reads,
                writes={"trial": trial_table(self.output.frame.name, tile)},
                params={"tile": zoned, "rules": rules},
                scratch=self.output.colour_scratch(tile, zoned.parts) // 4,
            )


def width_job(outputs: list[WideningJobs], width: float | None) -> Job:
    """The width for all outputs: the given one, or the best of their trials."""
    if width is not None:
        return Job(
            stage="projection",
            item="widening",
            function=fixed_width,
            reads={},
            writes={"widening": WIDENING},
            params={"width": width},
        )
    frames = [jobs.output.frame for jobs in outputs]
    return Job(
        stage="projection",
        item="widening",
        function=choose_width,
        reads={"trials": Stream(tuple(trial_table(frame.name, tile) for frame in frames for tile in frame.tiles))},
        writes={"widening": WIDENING},
    )
