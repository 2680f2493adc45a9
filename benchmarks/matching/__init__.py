"""Benchmarks of matching, compared with the published experiments."""
