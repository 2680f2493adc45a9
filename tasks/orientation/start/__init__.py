"""Approximate exterior orientation of a whole block, and its place in the project's system."""
