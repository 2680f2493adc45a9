"""Simulated flights: is the ground bent more than stated, and is a dome named?

    python -m benchmarks flights [--quick] [count=N]

Every flight goes through the functions of the product that a workflow calls, with what the tags of its photographs say. A page and
a table of all flights are written to benchmarks/results.
"""

import csv
import time
from dataclasses import asdict, fields
from multiprocessing import get_context
from pathlib import Path

from benchmarks.flights.flights_page import page
from benchmarks.flights.judged_flight import Judged, flown_and_judged
from benchmarks.flights.measured_flight import kinds
from benchmarks.instrument.result_page import RESULTS, write_page

ALL, QUICK = 360, 40
"""Flights: every kind three times, or what takes a minute."""
CORES = 2


def main(words: list[str]) -> None:
    """Fly, judge, and write the page."""
    given = dict(word.split("=") for word in words if "=" in word)
    quick = "--quick" in words
    count = int(given.get("count", QUICK if quick else ALL))
    started = time.monotonic()
    # The first flight alone: it compiles what the workers then find in the cache.
    first, *others = kinds(count)
    rows = [flown_and_judged(*first)]
    with get_context("spawn").Pool(CORES) as pool:
        rows += pool.starmap(flown_and_judged, others, chunksize=1)
    name = "flights_quick" if quick else "flights"
    _keep(RESULTS / f"{name}.csv", rows)
    write_page("flights", words, page(rows, time.monotonic() - started), RESULTS / f"{name}.md")


def _keep(path: Path, rows: list[Judged]) -> None:
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Judged)], lineterminator="\n")
        table.writeheader()
        for row in rows:
            rounded = {name: f"{value:.6g}" if isinstance(value, float) else value for name, value in asdict(row).items()}
            table.writerow(rounded)
