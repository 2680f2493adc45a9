"""Names of photographs as names of files: any name, never the same file for two of them."""

import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orthomill.pipeline.storage.file_names import LONGEST, file_name, path_of

NAMES = st.text(st.characters(exclude_characters="/\0", exclude_categories=("Cs",)), min_size=1, max_size=260)
CLOSE = st.text(" ~%.-_+zarjson()[]äÄ", min_size=1, max_size=6)


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(NAMES | CLOSE)
def test_any_name_is_a_file_inside_its_folder(tmp_path, name):
    path = tmp_path / file_name(name)
    assert path.parent == tmp_path and path.name not in (".", "..", "zarr.json") and not path.name.startswith((".", "__"))
    # Room for ".12345.12345.json" and for temporary names.
    assert len(os.fsencode(path.name)) <= LONGEST + 2 <= 255 - 60
    path.write_text("x")
    path.unlink()


@settings(max_examples=300)
@given(st.sets(CLOSE | NAMES, min_size=2, max_size=12))
def test_different_names_are_different_files(names):
    assert len({file_name(name) for name in names}) == len(names)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("DJI_0030 level 1", "DJI_0030~level~1"),
        ("left+right matches", "left+right~matches"),
        ("p(1)", "p(1)"),
        ("p~1", "p%7E1"),
        ("α", "%CE%B1"),
        ("zarr.json", "%7Aarr.json"),
        ("..", "%2E."),
        ("__init__", "%5F_init__"),
        ("a\nb", "a%0Ab"),
    ],
)
def test_ordinary_names_stay_readable(name, expected):
    assert file_name(name) == expected


def test_long_names_that_differ_at_their_end_are_different_files():
    first, second = (file_name("x" * 250 + end) for end in "ab")
    assert first != second and first[:100] == second[:100] == "x" * 100


def test_the_ending_of_a_table_survives_a_long_name():
    path = path_of(f"tie_points/matches/{'甲' * 80}+{'乙' * 80}.parquet", ".parquet")
    assert path.suffix == ".parquet" and path.parts[:2] == ("tie_points", "matches") and len(path.name) < 255
