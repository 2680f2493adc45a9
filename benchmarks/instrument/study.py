"""A study: what it measures, of which code, what it needs, how long it takes, and which pages it writes.

The module of a study has a function `main(words)`; `words` are what follows its name on the command line. It measures, and keeps
its page with `write_page`, which puts command, commit, machine and date at the top.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Literal, get_args

Cost = Literal["seconds", "minutes", "an hour", "hours"]
COSTS: tuple[Cost, ...] = get_args(Cost)


@dataclass(frozen=True)
class Study:
    """`module` below benchmarks; `code`: folders of the checkout whose code it measures; `pages`: paths in the checkout, with
    wildcards, and none where the study only prints; `words` that it understands; `needs`: what this repository does not bring."""

    name: str
    module: str
    measures: str
    cost: Cost
    code: tuple[str, ...]
    needs: str = ""
    words: str = ""
    pages: tuple[str, ...] | None = field(default=None)

    @property
    def written(self) -> tuple[str, ...]:
        """Its pages; where nothing else is said, one of its own name."""
        return (f"benchmarks/results/{self.name}.md",) if self.pages is None else self.pages

    @property
    def main(self) -> Callable[[list[str]], None]:
        """What runs it. Only then are the libraries that it uses imported."""
        function: Callable[[list[str]], None] = import_module(f"benchmarks.{self.module}").main
        return function
