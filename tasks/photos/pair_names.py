"""Whether the names of photographs tell all pairs of them apart.

Pairs are called `left-right` and `left+right`. Of the photographs a, a-b, b-c and c, the pairs (a, b-c) and (a-b, c) would have one
name, and one raster.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator

from orthomill.schemas.errors import PhotoError

JOINERS = ("-", "+")


def refuse_ambiguous(names: Iterable[str]) -> None:
    """Raises PhotoError for photographs of which two pairs would have the same name."""
    known = frozenset(names)
    for joiner in JOINERS:
        for first, second in _same_pairs(known, joiner):
            raise PhotoError(
                f"The pair of the photographs {' and '.join(first)} would have the same name as that of {' and '.join(second)}; "
                f"rename one of them, for example without '{joiner}'."
            )


def _same_pairs(known: frozenset[str], joiner: str) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    """Two pairs of different photographs that are joined to one name."""
    # The part that moves from the one name to the other (b above) -> the first photograph of either pair.
    starts: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for name in sorted(known):
        for start, rest in _splits(name, joiner):
            if start in known:
                starts[rest].append((start, name))
    for name in sorted(known):
        for start, rest in _splits(name, joiner):
            for short, long in starts.get(start, ()) if rest in known else ():
                # One pair the other way round (1, 1-1 and 1-1, 1) is planned in one of its two orders only.
                if short != name and long != rest and {short, name} != {long, rest}:
                    yield (short, name), (long, rest)


def _splits(name: str, joiner: str) -> Iterator[tuple[str, str]]:
    """Start and rest of a name at every place of the joiner."""
    at = name.find(joiner)
    while at >= 0:
        yield name[:at], name[at + 1 :]
        at = name.find(joiner, at + 1)
