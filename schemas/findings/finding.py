"""What every finding is: a code with names and numbers, and the sentence that tells it.

Tables carry codes and numbers, and programs that read them compare these; the sentence is made of them when a report is written.
"""

from collections.abc import Sequence
from typing import Self

from pydantic import BaseModel, ConfigDict

Vector = tuple[float, float, float]


# The literal `code` of each class selects it when a table is read. Codes are therefore part of the file format and never change;
# names of classes and sentences may.
class SpokenFinding(BaseModel):
    """Something that a reader must know."""

    model_config = ConfigDict(frozen=True)

    @property
    def sentence(self) -> str:
        """The finding as a whole sentence: what was found, and what to do about it."""
        raise NotImplementedError(f"{type(self).__name__} has no sentence")

    @property
    def alike(self) -> str | None:
        """What findings that are told in one sentence have in common; None: each has its own."""
        return None

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        """Findings that are alike as one sentence with a list: ten cameras of unknown focal length are one thing to know."""
        raise NotImplementedError(f"{cls.__name__} has no sentence of many")


def two_digits(value: float) -> str:
    """Two digits: not 3e+02 for hundreds, nor 0.00 for thousandths; a standard error has no more digits."""
    return f"{float(f'{value:.2g}'):g}"
