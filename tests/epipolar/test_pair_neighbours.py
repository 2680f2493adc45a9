"""Which pairs are taken first: the nearest neighbours of every photograph in their directions, then wide ones."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import Candidate, Places, best_pairs, neighbours, why_not

FLYING, SIDE = 100.0, 140.0
"""m: height above ground, and side of the square that a photograph shows"""


def lattice(along: float, across: float, strips: int = 3, photos: int = 6, noise: float = 0.0) -> np.ndarray:
    """(N, 3) m: projection centres of parallel strips, photograph after photograph."""
    centres = [(along * k, across * s, FLYING) for s in range(strips) for k in range(photos)]
    return np.array(centres) + np.random.default_rng(0).normal(0.0, max(noise, 1e-30), (len(centres), 3))


def useful(centres: np.ndarray) -> list[Candidate]:
    """All useful pairs over flat ground."""
    found = []
    for i in range(len(centres)):
        for j in range(i + 1, len(centres)):
            base = centres[j] - centres[i]
            common = np.prod(np.maximum(1.0 - np.abs(base[:2]) / SIDE, 0.0))
            found.append(Candidate(i, j, float(common), float(np.linalg.norm(base) / FLYING), 0.0, 1.0))
    return [c for c in found if not why_not(c, PairChoice())]


def chosen(centres: np.ndarray, **settings_) -> list[Candidate]:
    """The pairs chosen where every place needs more of them."""
    return best_pairs(useful(centres), centres, [Places()] * len(centres), PairChoice(**settings_))


def square(centre: np.ndarray) -> Places:
    """Places every 10 m that a photograph sees."""
    rows, cols = (np.arange(np.ceil((x - SIDE / 2) / 10), np.floor((x + SIDE / 2) / 10) + 1) for x in centre[1::-1])
    return Places((int(row), int(col)) for row in rows for col in cols)


def pairs_over_places(pairs: list[Candidate], places: list[Places]) -> Counter:
    return Counter(place for c in pairs for place in places[c.first] & places[c.second])


@settings(max_examples=10, deadline=None)
@given(along=st.floats(12.0, 40.0), ratio=st.floats(1.2, 2.5), enough=st.integers(1, 6))
def test_wide_pairs_are_taken_only_where_places_need_them(along, ratio, enough):
    centres = lattice(along, along * ratio)
    places = [square(centre) for centre in centres]
    kept = best_pairs(useful(centres), centres, places, PairChoice(per_place=enough, per_photo=8))
    free = chosen(centres, per_photo=8)
    assert along_strips(6, 3) <= numbers(kept) and len(kept) <= len(free)
    over, free_over = pairs_over_places(kept, places), pairs_over_places(free, places)
    assert set(over) == set(free_over), "no place loses all of its pairs"
    for c in free:
        if c not in kept:
            ground = places[c.first] & places[c.second]
            assert sum(over[place] < enough for place in ground) < 0.25 * len(ground)


@pytest.mark.parametrize(("along", "across", "least", "most"), [(12.0, 25.0, 0.0, 0.8), (50.0, 80.0, 0.95, 1.0)])
def test_a_dense_block_needs_fewer_pairs_and_a_sparse_one_nearly_all(along, across, least, most):
    centres = lattice(along, across)
    kept = best_pairs(useful(centres), centres, [square(centre) for centre in centres], PairChoice())
    assert least <= len(kept) / len(chosen(centres)) <= most


def numbers(pairs: list[Candidate]) -> set[tuple[int, int]]:
    return {(c.first, c.second) for c in pairs}


def along_strips(photos: int, strips: int, step: int = 1) -> set[tuple[int, int]]:
    return {(s * photos + k, s * photos + k + step) for s in range(strips) for k in range(photos - step)}


@settings(max_examples=20, deadline=None)
@given(along=st.floats(15.0, 50.0), ratio=st.floats(1.1, 2.0), per_photo=st.integers(4, 8))
def test_next_photographs_along_the_strip_are_always_paired(along, ratio, per_photo):
    centres = lattice(along, min(along * ratio, 100.0))
    kept = chosen(centres, per_photo=per_photo)
    assert along_strips(6, 3) <= numbers(kept)
    count = np.bincount([n for c in kept for n in (c.first, c.second)])
    assert count.max() <= per_photo and count.min() >= 2


def test_half_of_the_pairs_are_wide():
    centres = lattice(20.0, 60.0)
    kept = chosen(centres)
    wide = [c for c in kept if (c.first, c.second) not in along_strips(6, 3)]
    assert len(wide) >= len(kept) / 2 and np.mean([c.base_height for c in wide]) > 0.5


@pytest.mark.parametrize("strips", [1, 3])
def test_neighbours_of_a_dense_strip_skip_photographs_that_are_too_near(strips):
    """Photographs every 6 m: base over height 0.06 is below 0.1, so the one after the next is the neighbour."""
    centres = lattice(6.0, 50.0, strips=strips, photos=12)
    near = numbers(neighbours(useful(centres), centres))
    assert along_strips(12, strips, step=2) <= near
    assert not near & (along_strips(12, strips, step=1) | along_strips(12, strips, step=4))
    assert along_strips(12, strips, step=2) <= numbers(chosen(centres, per_photo=6))


def test_a_pair_with_a_photograph_between_is_no_neighbour():
    centres = lattice(20.0, 60.0)
    assert numbers(neighbours(useful(centres), centres)) == along_strips(6, 3) | {(k, k + 6) for k in range(12)}


def test_the_last_bits_of_the_orientation_do_not_decide():
    """In a regular block many distances are equal; a micrometre may not choose among them."""
    exact, disturbed = chosen(lattice(20.0, 20.0)), chosen(lattice(20.0, 20.0, noise=1e-6))
    assert numbers(exact) == numbers(disturbed)


def test_pairs_do_not_depend_on_the_order_of_the_candidates():
    centres = lattice(23.0, 41.0, noise=3.0)
    pairs = useful(centres)
    shuffled = [pairs[k] for k in np.random.default_rng(3).permutation(len(pairs))]
    unseen = [Places()] * len(centres)
    assert best_pairs(pairs, centres, unseen, PairChoice()) == best_pairs(shuffled, centres, unseen, PairChoice())


def test_after_the_neighbours_the_best_pair_comes_first():
    centres = np.array([(0.0, 0, 0), (30, 0, 0), (60, 0, 0), (90, 0, 0)])
    pairs = [Candidate(0, 1, 0.8, 0.3, 0, 1), Candidate(1, 2, 0.8, 0.3, 0, 1), Candidate(0, 2, 0.6, 0.6, 0, 1)]
    pairs += [Candidate(1, 3, 0.5, 0.6, 0, 1), Candidate(2, 3, 0.8, 0.29, 0, 1), Candidate(0, 3, 0.4, 0.95, 0, 1)]
    order = [(c.first, c.second) for c in best_pairs(pairs, centres, [Places()] * 4, PairChoice(per_photo=6))]
    assert order == [(2, 3), (0, 1), (1, 2), (0, 3), (0, 2), (1, 3)]
