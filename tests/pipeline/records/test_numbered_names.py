"""Names and keys have numbers in the order in which they came, whatever their hashes are."""

import sys
from threading import Event, Thread

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.records.numbered_names import NumberedKeys, NumberedNames

KEYS = st.tuples(st.sampled_from("ab"), st.text(max_size=3), st.integers(-(2**31), 2**31 - 1), st.integers(0, 9))


@settings(deadline=None)
@given(st.lists(st.binary(max_size=3)))
def test_names_have_the_numbers_that_a_dictionary_would_give_them(given_names):
    numbered, expected = NumberedNames(), dict[bytes, int]()
    for name in given_names:
        assert numbered.find(name) == expected.get(name)
        assert numbered.add(name) == expected.setdefault(name, len(expected))
    assert [numbered[number] for number in range(len(numbered))] == list(expected)
    assert all(numbered.find(name) == number for name, number in expected.items())


@settings(deadline=None)
@given(st.lists(KEYS, unique=True))
def test_keys_come_back_as_they_were(given_keys):
    keys = NumberedKeys()
    assert [keys.add(key) for key in given_keys] == list(range(len(given_keys)))
    assert list(keys) == given_keys and keys[1:3] == given_keys[1:3]
    assert all(key in keys and keys.add(key) == keys.number(key) == number for number, key in enumerate(given_keys))
    assert list(keys.of_stage("b")) == [number for number, key in enumerate(given_keys) if key[0] == "b"]


def test_what_is_not_there_is_not_found():
    keys = NumberedKeys()
    keys.add(("a", "tile", 0, 0))
    assert keys.find(("a", "other", 0, 0)) is None and ("a", "tile", 0, 1) not in keys and "tile" not in keys
    with pytest.raises(KeyError):
        keys.number(("a", "tile", 1, 0))
    with pytest.raises(IndexError):
        keys[1]


def test_another_thread_finds_names_while_more_are_added():
    names, missed, done = NumberedNames(), [], Event()
    known = [f"first {number}".encode() for number in range(50)]
    for name in known:
        names.add(name)

    def look() -> None:
        try:
            while not done.is_set():
                missed.extend(name for name in known if names.find(name) is None)
        except IndexError as error:
            missed.append(error)

    looking = Thread(target=look)
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    looking.start()
    try:
        for number in range(20_000):
            names.add(f"later {number}".encode())
    finally:
        sys.setswitchinterval(before)
        done.set()
        looking.join()
    assert not missed
