"""Benchmarks of matching, beside the published experiments."""
