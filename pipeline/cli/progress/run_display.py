"""The progress of a run as one context: costs are counted once, map and terminal tell the same, and the next run knows them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from orthomill.kernels.kernel_cache import kernels_are_kept
from orthomill.pipeline.cli.progress.progress_lines import ProgressLines
from orthomill.pipeline.engine.foresight import photograph_pixels
from orthomill.pipeline.engine.runner import Runner
from orthomill.pipeline.engine.session import Session, Watcher
from orthomill.pipeline.forecast.known_costs import RunCosts, expectations, write_costs
from orthomill.pipeline.watching.cost_model import CostModel
from orthomill.pipeline.watching.live_map import live_map
from orthomill.pipeline.watching.run_watch import Watchers


@contextmanager
def run_display(
    session: Session, runner: Runner, workers: int, console: Console, announce: Callable[[str], None], as_json: bool
) -> Iterator[Watcher]:
    """The map of tiles and the lines of the terminal for one run."""
    titles = {stage.kind: stage.title for stage in session.stages}
    megapixels, tile = photograph_pixels(session) / 1e6, session.project.tile
    known = expectations(session.folder, megapixels, tile)
    # One job after another is one worker, however many were asked for.
    shared = workers if runner.dashboard else 1
    model = CostModel(tuple(titles), shared, known, cold=not kernels_are_kept(), specs=session.graph.specs)
    try:
        with live_map(session, runner, model, announce) as tiles, ProgressLines(titles, model, console, as_json) as lines:
            yield Watchers((model, tiles, lines))
    finally:
        # Nothing could be reduced to the pixels of another run without those of this one.
        if megapixels:
            write_costs(session.folder, RunCosts(megapixels, tile, model.costs(), model.grids))
