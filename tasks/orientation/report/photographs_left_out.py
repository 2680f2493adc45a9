"""What is said of the photographs that joined no block: one sentence for all that share a reason."""

from collections.abc import Iterator, Sequence

from orthomill.schemas.errors import some_of
from orthomill.schemas.orientation import Unoriented


def left_out_sentences(unoriented: Sequence[Unoriented]) -> Iterator[str]:
    """The reasons, in the order of the first photograph of each."""
    alike: dict[str, list[Unoriented]] = {}
    for one in unoriented:
        # Most reasons begin with the name of the photograph, and are the same sentence for others behind it.
        alike.setdefault(one.reason.removeprefix(f"{one.photo} "), []).append(one)
    for rest, ones in alike.items():
        yield ones[0].reason if len(ones) == 1 else f"Each of {some_of([one.photo for one in ones])} {rest}"
