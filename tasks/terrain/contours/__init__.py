"""Contours of the terrain."""
