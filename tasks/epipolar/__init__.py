"""The stage `epipolar`: selection of the pairs to be matched, and their epipolar images."""
