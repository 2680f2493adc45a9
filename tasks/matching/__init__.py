"""Matching: interest points, correlation, least-squares matching, windows, and dense matching of epipolar pairs."""
