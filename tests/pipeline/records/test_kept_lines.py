"""Of the lines about a job the larger one is kept, in whatever order they are read."""

from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.records.kept_lines import KeptLines
from orthomill.pipeline.records.packed_list import BLOCK
from orthomill.pipeline.records.record_lines import RecordLine

LINES = st.builds(RecordLine, st.integers(0, 2), st.integers(0, 3), st.just(0.0), st.sampled_from([b"", b"{1}", b"{2}"]))


@settings(deadline=None)
@given(st.lists(st.tuples(st.tuples(st.sampled_from("ab"), st.integers(0, 2), st.just(0)), LINES)))
def test_lines_are_those_that_a_dictionary_would_keep(read):
    kept, expected = KeptLines(), dict[tuple, RecordLine]()
    for place, line in read:
        kept.keep(place, line)
        if place not in expected or expected[place][:3] <= line[:3]:
            expected[place] = line
    assert dict(kept) == expected and list(kept) == list(expected)
    assert kept.get(("c", 0, 0)) is None and ("c", 0, 0) not in kept and all(kept.get(place) == kept[place] for place in kept)


def test_texts_that_are_packed_come_back():
    kept, count = KeptLines(), 3 * BLOCK + 1
    for number in range(count):
        kept.keep(("tile", number, 0), RecordLine(1, 3, 0.5 * number, b'{"row":%d}' % number))
    assert len(kept) == count
    assert all(kept["tile", number, 0] == RecordLine(1, 3, 0.5 * number, b'{"row":%d}' % number) for number in range(count))
