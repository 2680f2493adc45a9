"""Benchmarks of calibration, rendered and real."""
