"""Which photograph a word of a file means: folders, the extension of an image and capitals do not matter.

Capitals do where the project has two photographs that differ in nothing else.
"""

from collections import Counter
from collections.abc import Iterable

EXTENSIONS = frozenset({"jpg", "jpeg", "tif", "tiff", "png", "dng", "arw", "cr2", "cr3", "nef", "heic"})
"""what people's files call photographs; the project's own may have been converted since"""


def photo_stem(word: str | None) -> str:
    """The name of a photograph without folders and without the extension of an image file."""
    # Only extensions of images are cut off: names such as "flight.2" contain a dot of their own. Windows has backslashes.
    name = (word or "").strip().replace("\\", "/").rstrip("/").rpartition("/")[2].strip()
    head, dot, tail = name.rpartition(".")
    return head if dot and tail.lower() in EXTENSIONS else name


def is_image_word(word: str) -> bool:
    """Whether a word ends like the name of an image file."""
    return word.strip().rpartition(".")[2].lower() in EXTENSIONS and "." in word.strip()[1:]


class PhotographNames:
    """The photographs of a project by the words that files may use for them."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self._exact = frozenset(self.names)
        times = Counter(name.casefold() for name in self.names)
        self._folded = {name.casefold(): name for name in self.names if times[name.casefold()] == 1}

    def find(self, word: str | None) -> str | None:
        """The photograph that a word means; None where the project does not have it."""
        for own in ((word or "").strip(), photo_stem(word)):
            if own in self._exact:
                return own
        return self._folded.get(photo_stem(word).casefold()) or self._folded.get((word or "").strip().casefold())
