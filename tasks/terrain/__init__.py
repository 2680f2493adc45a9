"""Bare ground of the surface model, and what stands on it."""
