"""Numbers as the report prints them: what is printed reads back as the number, to the digits that are shown."""

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from orthomill.pipeline.report.numbers import (
    ABSENT,
    MINUS,
    NARROW_SPACE,
    column_texts,
    decimals_of,
    duration_text,
    is_numeric,
    memory_text,
    nice_step,
    number_text,
    tick_text,
    ticks,
)

FINITE = st.floats(-1e11, 1e11, allow_nan=False).filter(lambda value: value == 0 or abs(value) > 1e-30)
POWERS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def read(text: str) -> float:
    """A printed number back as a number."""
    plain = text.replace(MINUS, "-")
    if "·" in plain:
        mantissa, power = plain.replace(NARROW_SPACE, "").split("·10")
        return float(mantissa) * 10.0 ** int(power.translate(POWERS))
    return float(plain.replace(NARROW_SPACE, ""))


@settings(max_examples=300, deadline=None)
@given(value=FINITE)
def test_a_printed_float_reads_back_to_its_last_digit(value):
    text = number_text(value)
    unit = 10.0 ** -len(text.partition(".")[2]) if "·" not in text else abs(value) * 1e-3
    assert abs(read(text) - value) <= 0.5000001 * unit + 1e-12 * abs(value)


@settings(max_examples=100, deadline=None)
@given(value=st.integers(-(10**15), 10**15))
def test_a_printed_whole_number_reads_back_exactly(value):
    assert read(number_text(value)) == value
    assert NARROW_SPACE not in number_text(value % 10_000)


@settings(max_examples=200, deadline=None)
@given(value=FINITE, decimals=st.integers(0, 6))
def test_nothing_is_printed_as_minus_zero(value, decimals):
    text = number_text(value, decimals)
    assert not (text.startswith(MINUS) and read(text) == 0)


@settings(max_examples=200, deadline=None)
@given(values=st.lists(FINITE.filter(lambda v: v == 0 or abs(v) > 1e-5), min_size=1, max_size=8))
def test_the_decimal_points_of_a_column_are_aligned(values):
    texts = column_texts(tuple(values))
    assert len({len(text.partition(".")[2]) for text in texts}) == 1


def test_absent_cells_and_words_stay_what_they_are_in_a_column():
    assert column_texts((None, "word", float("nan"), 1.25, 3)) == [ABSENT, "word", ABSENT, "1.25", "3"]
    assert decimals_of((None, "word", 3)) == 0 and decimals_of(()) == 0


@pytest.mark.parametrize(
    ("value", "decimals"), [(0.5, 1), (0.123456, 3), (12.3456, 2), (5.0, 0), (409123.45678, 3), (0.000123456, 6), (1234.5, 1)]
)
def test_about_four_digits_are_shown_and_none_that_were_not_given(value, decimals):
    assert decimals_of((value,)) == decimals


@pytest.mark.parametrize(
    ("values", "numeric"), [((1, 2.5, None), True), ((True, False), False), (("a", 1), False), ((None, None), False), ((), False)]
)
def test_columns_of_numbers_are_set_to_the_right(values, numeric):
    assert is_numeric(values) is numeric


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.0 s"),
        (9.94, "9.9 s"),
        (12.4, "12 s"),
        (59.4, "59 s"),
        (60, "1 min 00 s"),
        (3599, "59 min 59 s"),
        (7620, "2 h 07 min"),
    ],
)
def test_durations(seconds, text):
    assert duration_text(seconds).replace(NARROW_SPACE, " ") == text


@pytest.mark.parametrize(("count", "text"), [(None, ABSENT), (2**20, "1 MiB"), (2**30 - 1, "1024 MiB"), (2**30, "1.00 GiB")])
def test_memory(count, text):
    assert memory_text(count).replace(NARROW_SPACE, " ") == text


# --- axes --------------------------------------------------------------------------------------------------------------------

SPANS = st.floats(1e-9, 1e9)


@settings(max_examples=200, deadline=None)
@given(span=SPANS, parts=st.integers(1, 12))
def test_a_step_is_round_and_divides_its_span_into_about_as_many_parts(span, parts):
    step = nice_step(span, parts)
    mantissa = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
    assert min(abs(mantissa - factor) for factor in (1, 2, 5)) < 1e-6
    assert parts / 2.6 <= span / step <= parts * 2.6


@pytest.mark.parametrize("span", [0.0, -1.0, math.inf, math.nan])
def test_no_span_has_the_step_one(span):
    assert nice_step(span, 5) == 1.0


@settings(max_examples=200, deadline=None)
@given(low=st.floats(-1e6, 1e6), span=st.floats(1e-3, 1e6), parts=st.integers(2, 10))
def test_ticks_are_multiples_of_the_step_inside_the_range_and_complete(low, span, parts):
    high = low + span
    assume(high > low)
    step, found = nice_step(high - low, parts), ticks(low, high, parts)
    slack = 1e-6 * step + 1e-9 * max(abs(low), abs(high))
    assert all(abs(tick / step - round(tick / step)) < 1e-6 for tick in found)
    assert all(low - slack <= tick <= high + slack for tick in found)
    assert not found or (found[0] - step < low + slack and found[-1] + step > high - slack)


@settings(max_examples=200, deadline=None)
@given(low=st.floats(-1e4, 1e4), span=st.floats(1e-3, 1e4), parts=st.integers(2, 10))
def test_neighbouring_ticks_are_labelled_differently(low, span, parts):
    step = nice_step(span, parts)
    texts = [tick_text(tick, step) for tick in ticks(low, low + span, parts)]
    assert len(set(texts)) == len(texts)


def test_a_tick_has_the_decimals_of_its_step():
    assert tick_text(0.30000000000000004, 0.1) == "0.3"
    assert tick_text(-1e-17, 0.1) == "0.0"
    assert tick_text(20000.0, 5000.0).replace(NARROW_SPACE, " ") == "20 000"
    assert tick_text(2e-6, 1e-6).replace(NARROW_SPACE, "") == "2.000·10⁻⁶"
