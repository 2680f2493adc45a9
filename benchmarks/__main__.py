"""All benchmarks, one after the other: `make bench`."""

import sys

from benchmarks import memory_growth, same_everywhere, time_by_stage, volos
from benchmarks.matching import matching_speed, published_tables, window_sizes


def main() -> None:
    """Run those named on the command line, or all."""
    known = {
        "volos": lambda: volos.main([]),
        "same_everywhere": same_everywhere.main,
        "memory_growth": memory_growth.main,
        "time_by_stage": lambda: time_by_stage.main([]),
        "matching": lambda: published_tables.main([]),
        "matching_speed": matching_speed.main,
        "window_sizes": window_sizes.main,
    }
    for name in sys.argv[1:] or known:
        known[name]()


if __name__ == "__main__":
    main()
