"""Benchmarks of textures on surfaces."""
