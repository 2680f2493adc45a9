"""A row of the page of the whole: a published system or value, how to reach it here, and what is found here."""

from dataclasses import dataclass

from benchmarks.mission.page_cells import cell_of

RESULTS = "benchmarks/results"
NO_FIGURE, PICTURES = "no figure printed", "pictures only"
"""what stands in place of a published value that there is not"""


@dataclass(frozen=True)
class Found:
    """A value that a page of results holds: `text` with a brace for every (row, column) below a heading of the page."""

    page: str
    heading: str
    cells: tuple[tuple[str, str | int], ...]
    text: str = "{}"

    @property
    def path(self) -> str:
        """Of the page."""
        return f"{RESULTS}/{self.page}.md" if "/" not in self.page else self.page

    def __str__(self) -> str:
        return self.text.format(*(cell_of(self.path, self.heading, row, column) for row, column in self.cells))


@dataclass(frozen=True)
class Tested:
    """What a test holds: a sentence, and the file of the test."""

    sentence: str
    path: str

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class Cannot:
    """Why there is no value of ours; `path`: where that is written down."""

    sentence: str
    path: str

    def __str__(self) -> str:
        return f"None: {self.sentence}"


Ours = Found | Tested | Cannot


@dataclass(frozen=True)
class Row:
    """`source`: page and anchor below docs/sources; `reach`: a command, or a fragment of YAML in braces."""

    system: str
    source: str
    reach: str
    published: str
    ours: Ours
    cause: str = ""
    """where it differs: by what"""

    @property
    def why(self) -> str:
        """What is known of the difference, or that there is none, or nothing to compare."""
        if self.cause:
            return self.cause
        if isinstance(self.ours, Cannot):
            return "not compared"
        return "nothing printed to compare with" if self.published in (NO_FIGURE, PICTURES) else "as published"
