"""What is measured of orthomill, and the commands that measure it; results are in benchmarks/results."""

from importlib import import_module

# One thread for numerical libraries, before any of them is loaded: CPU seconds are then those of the work.
import_module("orthomill.pipeline")
