"""Benchmarks of the check of surfaces."""
