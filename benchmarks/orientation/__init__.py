"""Benchmarks of orientation and adjustment, simulated and real."""
