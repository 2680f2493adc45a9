"""Tie points: the same ground points found in many photographs, to a fraction of a pixel."""
