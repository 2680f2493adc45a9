"""The stage `epipolar`: which pairs are matched, and their epipolar images."""
