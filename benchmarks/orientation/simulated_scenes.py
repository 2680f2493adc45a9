"""Scenes that the tests simulate and the benchmarks measure at length: they lie in tests/support, which is no package."""

import sys
from importlib import import_module

from benchmarks.measured_run import ROOT

sys.path.append(str(ROOT / "tests" / "support" / "scenes"))
orienting = import_module("orienting")
published_pairs = import_module("published_pairs")
simulated_block = import_module("simulated_block")
photographed_layouts = import_module("photographed_layouts")
planted_blunders = import_module("planted_blunders")
