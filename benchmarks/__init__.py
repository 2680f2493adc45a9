"""What is measured of orthomill, and the commands that measure it; results are in benchmarks/results."""

from orthomill.pipeline.engine.one_thread import one_thread_from_here

# One thread for numerical libraries, before any of them is loaded: CPU seconds are then those of the work.
one_thread_from_here()
