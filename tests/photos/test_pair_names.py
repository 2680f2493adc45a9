"""Names of photographs of which two pairs would be called the same."""

from itertools import permutations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import PhotoError
from orthomill.tasks.photos.pair_names import JOINERS, refuse_ambiguous


@pytest.mark.parametrize("joiner", JOINERS)
def test_two_pairs_of_one_name_are_named_with_the_way_out(joiner):
    names = [f"1{joiner}2", "3", "1", f"2{joiner}3"]
    with pytest.raises(PhotoError) as caught:
        refuse_ambiguous(names)
    assert str(caught.value) == (
        f"The pair of the photographs 1 and 2{joiner}3 would have the same name as that of 1{joiner}2 and 3; "
        f"rename one of them, for example without '{joiner}'."
    )


@settings(max_examples=300)
@given(st.sets(st.text("ab-+", min_size=1, max_size=5), max_size=7))
def test_names_are_refused_exactly_when_two_pairs_collide(names):
    """Compared with all pairs in both orders; a pair whose two orders have one name is one pair."""
    unordered = {joiner: {} for joiner in JOINERS}
    for left, right in permutations(names, 2):
        for joiner in JOINERS:
            unordered[joiner].setdefault(f"{left}{joiner}{right}", set()).add(frozenset((left, right)))
    ambiguous = any(len(pairs) > 1 for of_joiner in unordered.values() for pairs in of_joiner.values())
    try:
        refuse_ambiguous(names)
    except PhotoError:
        assert ambiguous
    else:
        assert not ambiguous
