"""To which step coordinates are written: spreadsheets and maps round, and a list of whole metres is no better than 0.3 m.

The finest word decides: many coordinates end with a zero that nobody writes, few lists are rounded in one line only.
"""

import math
import re
from collections.abc import Iterable

_DIGITS = re.compile(r"[+-]?\d*(?:[.,](\d*))?(?:[eE]([+-]?\d+))?", re.ASCII)
ENOUGH_IN_PLAN, ENOUGH_HEIGHTS = 5, 3
"""different words, below which round numbers are chance"""
CUT = "which a spreadsheet has cut: show the cells as numbers with all digits, and save it anew"
"""what to say of such a number, as the end of a sentence"""
METRES_OF_A_DEGREE = 111_200.0


def written_step(words: Iterable[str], enough: int) -> float:
    """The step to which plain numbers are written, in their unit; 0 where fewer than `enough` differ and they have no decimals, or
    one is written otherwise (with minutes, or signs between thousands)."""
    listed = [word.strip() for word in words if word.strip()]
    steps = [_step(word) for word in listed]
    # Degrees with three decimals are alike all over a site: that all have as many decimals is no chance.
    alike = len(listed) >= enough and 0.0 < min(steps) == max(steps) < 1.0
    return min(steps) if alike or len(set(listed)) >= enough else 0.0


def lost_digits(word: str) -> bool:
    """Whether a spreadsheet has cut a number to a few digits and an exponent, as 3.91E+05 for 391000.125."""
    return "e" in word.lower() and _step(word.strip()) >= 1.0


def _step(word: str) -> float:
    match = _DIGITS.fullmatch(word)
    if match is None:
        return 0.0
    return 10.0 ** (int(match[2] or 0) - len(match[1] or "")) if abs(int(match[2] or 0)) < 100 else 0.0


def rounding_error(step: float) -> float:
    """The standard error of a number that is rounded to a step."""
    return step / math.sqrt(12.0)


def with_rounding(sigma: float, step: float) -> float:
    """A standard error of a coordinate that is written to a step, in the same unit; as it is where rounding adds little."""
    rounding = rounding_error(step)
    return math.hypot(sigma, rounding) if rounding > sigma else sigma
