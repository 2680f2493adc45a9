"""Which check points lie under vegetation, by names and shell patterns."""

from collections.abc import Iterable
from fnmatch import fnmatchcase

from orthomill.schemas.errors import WorkflowError


def under_vegetation(names: Iterable[str], patterns: tuple[str, ...]) -> frozenset[str]:
    """Those of the names that a pattern has. Raises WorkflowError for a pattern that has none: its points would count as on open
    ground."""
    known = tuple(names)
    found = {pattern: frozenset(name for name in known if fnmatchcase(name, pattern)) for pattern in patterns}
    lost = [pattern for pattern, own in found.items() if not own]
    if lost:
        names_known = f"they are {', '.join(known[:8])}{', ...' if len(known) > 8 else ''}" if known else "there are none"
        raise WorkflowError(f"No check point is called {' or '.join(lost)} (vegetated); {names_known}.")
    return frozenset().union(*found.values())
