"""Numbers as a report prints them: significant digits only, thousands separated, a true minus sign.

The cells of a column share one number of decimals, so that their decimal points are aligned.
"""

import math
from collections.abc import Iterable

from orthomill.schemas.memory import GIB, MIB

NARROW_SPACE = "\u202f"
MINUS = "\u2212"
ABSENT = "–"
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

Cell = float | int | str | bool | None


def number_text(value: Cell, decimals: int | None = None) -> str:
    """A value as text: grouped digits, about four significant ones (or `decimals` after the point); words unchanged."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ABSENT
    if isinstance(value, str):
        return value
    if isinstance(value, bool):  # before int, of which bool is a subclass
        return "yes" if value else "no"
    if math.isinf(value):
        return "∞" if value > 0 else MINUS + "∞"
    if isinstance(value, int):
        return _grouped(f"{abs(value):d}", value < 0)
    return _float_text(value, decimals_of((value,)) if decimals is None else decimals)


def _float_text(value: float, decimals: int) -> str:
    if value != 0 and (abs(value) < 1e-5 or abs(value) >= 1e12):
        mantissa, exponent = f"{abs(value):.3e}".split("e")
        power = "10" + str(int(exponent)).translate(SUPERSCRIPTS)
        return (MINUS if value < 0 else "") + f"{mantissa}{NARROW_SPACE}·{NARROW_SPACE}{power}"
    text = f"{abs(value):.{decimals}f}"
    # A value that rounds to zero has no sign: a column with both 0.00 and -0.00 would suggest a difference.
    return _grouped(text, value < 0 and float(text) != 0)


def _grouped(text: str, negative: bool) -> str:
    whole, point, fraction = text.partition(".")
    # ISO 80000-1 allows four digits without a space: 2100 is an EPSG code more often than a quantity.
    if len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", NARROW_SPACE)
    return (MINUS if negative else "") + whole + point + fraction


def decimals_of(values: Iterable[Cell]) -> int:
    """Decimals that suit all `values` together: about four digits of the typical one, but no more than the values have."""
    numbers = [abs(value) for value in values if isinstance(value, float) and math.isfinite(value)]
    sizes = sorted(number for number in numbers if number > 0)
    if not sizes:
        return 0
    typical = sizes[len(sizes) // 2]
    return min(_wanted_decimals(typical), max(_given_decimals(number) for number in numbers))


def _wanted_decimals(typical: float) -> int:
    """Millimetres for ground coordinates, else about four digits, three below 1."""
    if typical >= 10:
        return 3 if typical >= 1e4 else 2
    return 3 if typical >= 0.1 else min(2 - math.floor(math.log10(typical)), 6)


def _given_decimals(number: float) -> int:
    text = f"{number:.9f}".rstrip("0")  # nine decimals: beyond them float64 shows rounding, not information
    return len(text.partition(".")[2])


def column_texts(values: tuple[Cell, ...]) -> list[str]:
    """The cells of one column with common decimals."""
    decimals = decimals_of(values)
    return [number_text(value, decimals) for value in values]


def is_numeric(values: tuple[Cell, ...]) -> bool:
    """Whether a column holds numbers (ignoring absent ones), to be right-aligned."""
    present = [value for value in values if value is not None]
    return bool(present) and all(isinstance(value, int | float) and not isinstance(value, bool) for value in present)


def duration_text(seconds: float) -> str:
    """0.4 s, 12 s, 3 min 05 s, 2 h 07 min."""
    if seconds < 10:
        return f"{seconds:.1f}{NARROW_SPACE}s"
    if seconds < 60:
        return f"{seconds:.0f}{NARROW_SPACE}s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes}{NARROW_SPACE}min {rest:02d}{NARROW_SPACE}s"
    return f"{minutes // 60}{NARROW_SPACE}h {minutes % 60:02d}{NARROW_SPACE}min"


def memory_text(count: int | None) -> str:
    """Bytes in MiB or GiB."""
    if count is None:
        return ABSENT
    return f"{count / GIB:.2f}{NARROW_SPACE}GiB" if count >= GIB else f"{count / MIB:.0f}{NARROW_SPACE}MiB"


def bytes_text(count: int) -> str:
    """The size of a file as file managers print it: 13 kB, 65 MB, 1.2 GB."""
    for unit, size in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= size:
            return f"{count / size:.{1 if count < 10 * size else 0}f}{NARROW_SPACE}{unit}"
    return f"{count}{NARROW_SPACE}bytes"


def nice_step(span: float, parts: int) -> float:
    """The step of 1, 2 or 5 times a power of ten that divides `span` into about `parts`; 1 for an empty span."""
    if not (math.isfinite(span) and span > 0):
        return 1.0
    power = 10.0 ** math.floor(math.log10(span / parts))
    return min((factor * power for factor in (1, 2, 5, 10)), key=lambda step: abs(span / step - parts))


def ticks(low: float, high: float, parts: int) -> list[float]:
    """Round numbers between `low` and `high`, about `parts` of them."""
    step = nice_step(high - low, parts)
    # Counted in whole steps: adding a step again and again accumulates rounding, and 0.30000000000000004 is no tick.
    first = math.ceil(low / step - 1e-9)
    return [number * step for number in range(first, math.floor(high / step + 1e-9) + 1)]


def tick_text(value: float, step: float) -> str:
    """A tick with exactly the decimals that its step needs."""
    if step < 1e-5 or abs(value) >= 1e12:
        return number_text(0 if value == 0 else value)
    return _grouped(f"{abs(value):.{max(0, -math.floor(math.log10(step) + 1e-9))}f}", value < 0 and abs(value) > step / 2)
