"""What the stage `epipolar` tells of its pairs."""
