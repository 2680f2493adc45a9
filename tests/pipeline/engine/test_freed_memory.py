"""Memory that was freed goes back to the system, but only when it is much."""

import subprocess
import sys

import pytest

from orthomill.pipeline.engine.freed_memory import MUCH, give_back, occupied

FRAGMENTED = """
from orthomill.pipeline.engine.freed_memory import give_back, occupied
kept = [b"x" * (100_000 + k) for k in range(2000)]
before = occupied()
del kept[::2]
after, tried = occupied(), give_back(much=1)
print(tried, before - after, before - occupied())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs the GNU C library")
def test_pieces_between_what_lives_on_are_given_back():
    """A hundred megabytes in pieces: the system gets them when told, hardly any of them without."""
    settings = {"MALLOC_MMAP_THRESHOLD_": str(32 * 2**20), "MALLOC_TRIM_THRESHOLD_": str(256 * 2**20)}
    found = subprocess.run([sys.executable, "-c", FRAGMENTED], env=settings, capture_output=True, text=True, check=True)
    tried, alone, told = found.stdout.split()
    assert tried == "True" and int(alone) < 20e6 and int(told) > 70e6


TABLES = """
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from orthomill.pipeline.engine.freed_memory import give_back, occupied
table = pa.table({"x": pa.array(np.random.default_rng(1).integers(0, 256, 40_000_000))})
sink = pa.BufferOutputStream()
pq.write_table(table, sink)
del table, sink
kept = occupied()
give_back(much=1)
print(kept - occupied())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs the GNU C library")
def test_what_arrow_keeps_is_given_back():
    found = subprocess.run([sys.executable, "-c", TABLES], capture_output=True, text=True, check=True)
    assert int(found.stdout) > 20e6


def test_little_memory_is_kept_for_the_next_job():
    assert not give_back(much=2**60)


def test_a_process_knows_what_it_occupies():
    assert 20 * 2**20 < occupied() < 64 * 2**30 and MUCH > 512 * 2**20


def test_where_the_system_does_not_tell_nothing_is_tried(monkeypatch, tmp_path):
    monkeypatch.setattr("orthomill.pipeline.engine.freed_memory._OWN", tmp_path / "absent")
    assert occupied() == 0 and not give_back(much=0)
