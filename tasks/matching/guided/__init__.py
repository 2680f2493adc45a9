"""Matching along a short piece of the epipolar line, which a height model bounds."""
