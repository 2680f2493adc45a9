"""One small family of errors. Each message is a sentence for the user: what was found, where, what is needed, how to fix it."""

from collections.abc import Sequence


# One base class decides what the command line prints: these as a sentence, anything else with its traceback, as it is a defect.
class OrthomillError(Exception):
    """Anything that orthomill can explain to its user; shown without a traceback."""


class WorkflowError(OrthomillError):
    """The workflow file, or a file that it names, is invalid."""


class PhotoError(OrthomillError):
    """A photograph cannot be used."""


class ContentError(PhotoError):
    """What a file holds is no photograph that can be used: empty, cut, of another kind. Others beside it may be.

    `found`: what is wrong with the file `path`, as the end of a sentence that begins with it; `advice`: what to do.
    """

    def __init__(self, path: str, found: str, advice: str) -> None:
        super().__init__(f"{path} {found}; {advice}.")
        self.found = found


class GeometryError(OrthomillError):
    """The observations do not determine the unknowns."""


class StoreError(OrthomillError):
    """The project's store refuses a read or a write."""


class ResourceError(OrthomillError):
    """Memory, disk space or workers do not suffice."""


def some_of(names: Sequence[str], most: int = 8) -> str:
    """The first `most` names, and how many more there are."""
    # A block can have thousands of photographs, and the message must remain one readable sentence.
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(map(on_one_line, names[:most])) + more


def on_one_line(name: str) -> str:
    """A name of a file or photograph in a sentence: it may hold line ends, and bytes that are no text."""
    return "".join(letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in name)


def first_of(sentences: Sequence[str], most: int = 10) -> str:
    """The first `most` sentences, one a line, and how many more there are."""
    # A wrong separator makes a mistake of every line of a file: nobody reads a hundred thousand.
    more = [f"... and {len(sentences) - most} more."] if len(sentences) > most else []
    return "\n".join([*sentences[:most], *more])
