"""The progress of a run as one context: costs are counted once, and map and terminal tell the same."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from orthomill.pipeline.cli.progress_lines import ProgressLines
from orthomill.pipeline.engine.runner import Runner
from orthomill.pipeline.engine.session import Session, Watcher
from orthomill.pipeline.watching.cost_model import CostModel
from orthomill.pipeline.watching.live_map import live_map
from orthomill.pipeline.watching.run_watch import Watchers


@contextmanager
def run_display(
    session: Session, runner: Runner, workers: int, console: Console, announce: Callable[[str], None], as_json: bool
) -> Iterator[Watcher]:
    """The map of tiles and the lines of the terminal for one run."""
    titles = {stage.kind: stage.title for stage in session.stages}
    # One job after another is one worker, however many were asked for.
    model = CostModel({stage.kind: stage.usual_cost for stage in session.stages}, workers if runner.dashboard else 1)
    with live_map(session, runner, model, announce) as tiles, ProgressLines(titles, model, console, as_json) as lines:
        yield Watchers((model, tiles, lines))
