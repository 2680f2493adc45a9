"""Tables come back from their files as they went in."""

import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.tables.arrow_columns import PIECE, arrow_of, numpy_of
from orthomill.pipeline.storage.tables.table_files import read_table, write_table
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Columns, Table


@dataclass(frozen=True)
class Bytes(Columns):
    values: np.ndarray


@dataclass(frozen=True)
class Mixed(Columns):
    code: np.ndarray
    length: np.ndarray


@pytest.mark.parametrize("count", [0, 1, 70_000, PIECE, 2 * PIECE + 1, 20 * PIECE - 7])
def test_bytes_come_back_and_take_no_more_room_than_they_are(tmp_path, count):
    values = np.random.default_rng(1).integers(0, 256, count, dtype=np.uint8)
    write_table(Folder(tmp_path), "a.parquet", Bytes(values))
    found = read_table(Folder(tmp_path), "a.parquet", Table("a.parquet", Bytes)).values
    assert found.dtype == np.uint8 and np.array_equal(found, values)
    assert (tmp_path / "a.parquet").stat().st_size < count + 1000 + count // 1000


def test_a_long_file_is_packed_a_part_at_a_time(tmp_path):
    """Packed at once it would take three times its size in memory."""
    write_table(Folder(tmp_path), "a.parquet", Bytes(np.zeros(40 * PIECE, np.uint8)))
    groups = pq.ParquetFile(tmp_path / "a.parquet").metadata
    assert groups.num_row_groups == 3 and groups.row_group(0).num_rows == 16


def test_bytes_next_to_other_columns_remain_a_column_of_numbers(tmp_path):
    write_table(Folder(tmp_path), "a.parquet", Mixed(np.array([1, 2], np.uint8), np.array([0.5, 1.5])))
    assert pq.read_table(tmp_path / "a.parquet")["code"].to_pylist() == [1, 2]
    found = read_table(Folder(tmp_path), "a.parquet", Table("a.parquet", Mixed))
    assert found.code.tolist() == [1, 2] and found.length.tolist() == [0.5, 1.5]


def test_bytes_of_an_earlier_version_are_still_read(tmp_path):
    pq.write_table(pa.table({"values": pa.array(np.arange(9, dtype=np.uint8))}), tmp_path / "a.parquet")
    assert read_table(Folder(tmp_path), "a.parquet", Table("a.parquet", Bytes)).values.tolist() == list(range(9))


def test_a_flipped_byte_in_a_long_table_is_not_read_as_another_number(tmp_path):
    """Pages of bytes are stored as they are: without their checksums most flips would give other values."""
    path = tmp_path / "a.parquet"
    write_table(Folder(tmp_path), path.name, Bytes(np.random.default_rng(1).integers(0, 256, 20_000, dtype=np.uint8)))
    content = path.read_bytes()
    for at in range(100, 20_000, 997):
        path.write_bytes(content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :])
        with pytest.raises(StoreError, match=r"a\.parquet is damaged or from another version"):
            read_table(Folder(tmp_path), path.name, Table("a.parquet", Bytes))


@dataclass(frozen=True)
class AllKinds(Columns):
    text: np.ndarray
    good: np.ndarray
    number: np.ndarray
    metres: np.ndarray


@pytest.mark.parametrize("count", [0, 1, 9, 1000])
def test_texts_truth_values_and_numbers_come_back(tmp_path, count):
    draw = np.random.default_rng(count)
    texts = np.array(["", "b\u00e9ton", "a"])[draw.integers(0, 3, count)]
    value = AllKinds(texts, draw.random(count) < 0.5, draw.integers(-9, 9, count).astype(np.int16), draw.normal(size=count)[::-1])
    write_table(Folder(tmp_path), "a.parquet", value)
    found = read_table(Folder(tmp_path), "a.parquet", Table("a.parquet", AllKinds))
    for name in ("text", "good", "number", "metres"):
        own, other = getattr(value, name), getattr(found, name)
        assert own.tolist() == other.tolist() and (name == "text" or own.dtype == other.dtype)
    # As pyarrow's own conversion writes it, and reads it.
    table = pa.table({name: pa.array(getattr(value, name)) for name in ("text", "good", "number", "metres")})
    assert pq.read_table(tmp_path / "a.parquet").equals(table)


def test_a_part_of_a_column_is_that_part():
    for whole in (np.array(["x", "", "yz", "w"]), np.array([True, False, False, True]), np.arange(4, dtype=np.int32)):
        assert numpy_of(pa.chunked_array([arrow_of(whole)[1:3], arrow_of(whole)[3:]])).tolist() == whole[1:].tolist()


def test_a_missing_value_is_no_number(tmp_path):
    pq.write_table(pa.table({"code": pa.array([1, None], pa.uint8()), "length": [0.5, 1.5]}), tmp_path / "a.parquet")
    with pytest.raises(StoreError, match="is damaged or from another version"):
        read_table(Folder(tmp_path), "a.parquet", Table("a.parquet", Mixed))


_ALONE = """
import sys
from pathlib import Path
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.job import Table
from orthomill.schemas.observations import GroundPoints
import numpy as np
store, table = Store(Path(sys.argv[1])), Table("a/b.parquet", GroundPoints)
store.write_table(table, GroundPoints(*(np.arange(3.0) for _ in range(9))))
assert len(store.table(table)) == 3
assert "pandas" not in sys.modules, "40 MiB of every worker"
"""


def test_a_table_takes_no_library_of_its_own(tmp_path):
    done = subprocess.run([sys.executable, "-c", _ALONE, str(tmp_path)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
