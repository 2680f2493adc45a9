"""The tiles of the outputs in colour."""
